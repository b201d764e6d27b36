//! The one error type: problems after RFC 9457, with a stable `type` a kind.
//!
//! What a client may know goes into the problem; causes of failures on our side are logged here, once, and never sent.

use crate::store::StoreError;
use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use utoipa::openapi::{ContentBuilder, RefOr, Response as ApiResponse, ResponseBuilder};
use utoipa::{IntoResponses, PartialSchema, ToSchema};

/// An answer that says what went wrong (RFC 9457). `type` is stable; programs read it, people read `detail`.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Problem {
    /// Stable name of the kind, such as `/problems/frame-wrong-width`.
    #[serde(rename = "type")]
    #[schema(example = "/problems/frame-wrong-width")]
    kind: String,
    /// The kind in words.
    title: &'static str,
    /// The HTTP status.
    status: u16,
    /// What went wrong this time, with value and limit.
    detail: String,
    /// `value`, `limit` and what else programs may want.
    #[serde(flatten)]
    extra: Map<String, Value>,
    #[serde(skip)]
    retry_after_s: Option<u32>,
}

/// Makes a constructor a kind: `name: status, slug, title;`.
macro_rules! kinds {
    ($($(#[$doc:meta])* $name:ident: $status:ident, $slug:literal, $title:literal;)*) => {
        impl Problem {
            $($(#[$doc])*
            pub fn $name(detail: impl Into<String>) -> Self {
                Self::new(StatusCode::$status, $slug, $title, detail.into())
            })*
        }
    };
}

kinds! {
    /// A body that is not the JSON that is expected.
    malformed_body: BAD_REQUEST, "malformed-body", "The body is not what is expected";
    /// A query parameter that cannot be read.
    malformed_query: BAD_REQUEST, "malformed-query", "A query parameter cannot be understood";
    /// A path that names no possible resource.
    malformed_path: BAD_REQUEST, "malformed-path", "A part of the path cannot be understood";
    /// A header that cannot be read.
    malformed_header: BAD_REQUEST, "malformed-header", "A header cannot be understood";
    /// The body ended early.
    body_cut_short: BAD_REQUEST, "body-cut-short", "The body ended before it was whole";
    /// No token, or one that is not valid.
    unauthorized: UNAUTHORIZED, "unauthorized", "A valid access token is needed";
    /// The role of the token does not suffice.
    forbidden: FORBIDDEN, "forbidden", "The role of this token does not allow this";
    /// No such resource.
    not_found: NOT_FOUND, "not-found", "There is no such resource";
    /// No such view.
    view_out_of_range: NOT_FOUND, "view-out-of-range", "The acquisition has no such view";
    /// No such frame number.
    frame_out_of_range: NOT_FOUND, "frame-out-of-range", "The view has no such frame";
    /// No such method.
    method_not_allowed: METHOD_NOT_ALLOWED, "method-not-allowed", "The resource does not have this method";
    /// The client is too slow.
    too_slow: REQUEST_TIMEOUT, "too-slow", "The request took too long to arrive";
    /// The id belongs to something else.
    id_in_use: CONFLICT, "id-in-use", "The id belongs to a resource with other content";
    /// Another frame has this number.
    frame_differs: CONFLICT, "frame-differs", "Another frame has this number already";
    /// Another request brings the frame.
    superseded: CONFLICT, "superseded", "A newer request sends the same frame";
    /// The acquisition takes no more frames.
    acquisition_complete: CONFLICT, "acquisition-complete", "The acquisition is complete and takes no more frames";
    /// Frames are missing.
    acquisition_incomplete: CONFLICT, "acquisition-incomplete", "Frames of the acquisition are missing";
    /// Counts of frames contradict each other.
    frames_contradict: CONFLICT, "frames-contradict", "The numbers of frames contradict each other";
    /// Jobs need the acquisition.
    acquisition_in_use: CONFLICT, "acquisition-in-use", "Jobs refer to the acquisition";
    /// The key was used for something else.
    idempotency_key_reused: CONFLICT, "idempotency-key-reused", "The idempotency key belongs to another request";
    /// The job ended otherwise.
    job_ended: CONFLICT, "job-ended", "The job has already ended";
    /// Somebody decided otherwise.
    verdict_differs: CONFLICT, "verdict-differs", "There is another verdict already";
    /// Somebody else set a threshold before.
    threshold_moved: CONFLICT, "threshold-moved", "The model has another threshold by now";
    /// The job has not ended.
    inspection_running: CONFLICT, "inspection-running", "The inspection still runs";
    /// Nothing is sent to the endpoint.
    endpoint_disabled: CONFLICT, "endpoint-disabled", "The webhook endpoint is switched off";
    /// The upload got no byte for too long.
    upload_expired: GONE, "upload-expired", "The upload was not continued in time";
    /// A chunk that does not continue the file.
    wrong_offset: CONFLICT, "wrong-offset", "The chunk does not begin where the file ends";
    /// The archive is being unpacked.
    archive_unpacking: CONFLICT, "archive-unpacking", "The archive is being unpacked";
    /// Not version 1.0.0 of tus.
    wrong_tus_version: PRECONDITION_FAILED, "wrong-tus-version", "Only version 1.0.0 of tus is spoken";
    /// Not an archive of an acquisition.
    archive_refused: UNPROCESSABLE_ENTITY, "archive-refused", "The archive cannot be taken";
    /// The job has ended.
    provisional_gone: GONE, "provisional-gone", "The job has ended, and with it what was provisional";
    /// Retention took the frames.
    frames_removed: GONE, "frames-removed", "The frames of the acquisition were removed";
    /// Too many bytes.
    body_too_large: PAYLOAD_TOO_LARGE, "body-too-large", "The body is too large";
    /// Not a type that is taken.
    unsupported_media_type: UNSUPPORTED_MEDIA_TYPE, "unsupported-media-type", "The body is of a type that is not taken";
    /// A value outside its interval.
    out_of_range: UNPROCESSABLE_ENTITY, "out-of-range", "A value lies outside its interval";
    /// A threshold under what an inspection stored.
    below_look_again: UNPROCESSABLE_ENTITY, "below-look-again", "Nothing so low was stored of the inspection";
    /// A design that is no rope.
    design_impossible: UNPROCESSABLE_ENTITY, "design-impossible", "Such a rope cannot exist";
    /// A reference to something that is not there.
    unknown_reference: UNPROCESSABLE_ENTITY, "unknown-reference", "The body refers to something that does not exist";
    /// The digest does not match.
    digest_mismatch: UNPROCESSABLE_ENTITY, "digest-mismatch", "The digest does not match the bytes that arrived";
    /// The image is too large.
    frame_too_large: UNPROCESSABLE_ENTITY, "frame-too-large", "The image is larger than any frame may be";
    /// The image has another width than the sensor.
    frame_wrong_width: UNPROCESSABLE_ENTITY, "frame-wrong-width", "The image is not as wide as the sensor";
    /// A preview of a frame that nobody announced.
    frame_not_announced: CONFLICT, "frame-not-announced", "The frame was not announced";
    /// The image is not the reduced form of its frame.
    preview_wrong_size: UNPROCESSABLE_ENTITY, "preview-wrong-size", "The image is not as large as a preview of this frame is";
    /// Not a whole gray image.
    frame_unreadable: UNPROCESSABLE_ENTITY, "frame-unreadable", "The body is not a whole gray image";
    /// The model is of another rope.
    model_of_another_rope: UNPROCESSABLE_ENTITY, "model-of-another-rope", "The model was trained on another rope";
    /// The model does not know how often intact rope scores high.
    model_without_tail: UNPROCESSABLE_ENTITY, "model-without-tail", "The model does not tell how often intact rope scores high";
    /// A further acquisition is of another rope.
    acquisition_of_another_rope: UNPROCESSABLE_ENTITY, "acquisition-of-another-rope", "The acquisition shows another rope";
    /// Acquisitions of different camera heads.
    acquisitions_differ: UNPROCESSABLE_ENTITY, "acquisitions-differ", "The acquisitions cannot teach one model";
    /// The same rope would teach twice.
    ranges_overlap: UNPROCESSABLE_ENTITY, "ranges-overlap", "The same rope would teach twice";
    /// More than one request may ask.
    range_too_large: UNPROCESSABLE_ENTITY, "range-too-large", "The range is larger than one request may ask for";
    /// Nothing was inspected with a model.
    no_likelihood: NOT_FOUND, "no-likelihood", "The inspection has no likelihood maps";
    /// A defect that cannot be shown close up.
    no_card: NOT_FOUND, "no-card", "There is no card of the defect";
    /// Our fault.
    internal: INTERNAL_SERVER_ERROR, "internal", "The service failed";
    /// No room.
    insufficient_storage: INSUFFICIENT_STORAGE, "insufficient-storage", "There is no room for this";
    /// Too much to do.
    busy: SERVICE_UNAVAILABLE, "busy", "The service is busy";
    /// Not ready.
    not_ready: SERVICE_UNAVAILABLE, "not-ready", "The service is not ready";
}

impl Problem {
    fn new(status: StatusCode, slug: &'static str, title: &'static str, detail: String) -> Self {
        let retry_after_s = match status {
            StatusCode::SERVICE_UNAVAILABLE => Some(2),
            StatusCode::INSUFFICIENT_STORAGE => Some(10), // a person has to make room
            _ => None,
        };
        Self {
            kind: format!("/problems/{slug}"),
            title,
            status: status.as_u16(),
            detail,
            extra: Map::new(),
            retry_after_s,
        }
    }

    /// Adds a field for programs.
    pub fn with(mut self, name: &str, value: impl Serialize) -> Self {
        self.extra.insert(name.to_owned(), serde_json::to_value(value).unwrap_or(Value::Null));
        self
    }

    /// Adds the offending value and the limit that it broke.
    pub fn limit(self, value: impl Serialize, limit: impl Serialize) -> Self {
        self.with("value", value).with("limit", limit)
    }

    /// A chunk that is not what its checksum promised: a status of tus's own.
    pub fn checksum_mismatch(detail: impl Into<String>) -> Self {
        let status = StatusCode::from_u16(460).unwrap_or(StatusCode::BAD_REQUEST);
        Self::new(status, "checksum-mismatch", "The chunk is not what its checksum promised", detail.into())
    }

    /// True when the same request may succeed later.
    pub fn is_of_the_service(&self) -> bool {
        self.status >= 500
    }

    /// A value of the body outside its interval.
    pub fn outside(name: &str, value: f64, min: f64, max: f64) -> Self {
        Self::out_of_range(format!("{name} is {value}, but must lie between {min} and {max}"))
            .with("field", name)
            .limit(value, json!({ "min": min, "max": max }))
    }

    /// Something that is not there.
    pub fn no(what: &str, id: impl std::fmt::Display) -> Self {
        Self::not_found(format!("there is no {what} {id}"))
    }

    /// A failure of ours: logged here, not told.
    pub fn failure(error: impl std::fmt::Display) -> Self {
        tracing::error!(%error, "request failed");
        Self::internal("the cause is in the log of the service")
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        if error.disk_full() {
            tracing::error!(%error, "the disk is full");
            return Self::insufficient_storage(
                "the disk of the service is full: free some of it, then send the same again",
            );
        }
        Self::failure(error)
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let retry_after_s = self.retry_after_s;
        let mut response = (status, Json(self)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"ropescope\""));
        }
        if let Some(seconds) = retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

/// Problems that any request may meet.
pub struct ReadProblems;

/// Problems that a request with a body may meet besides.
pub struct WriteProblems;

fn problems(of: &[(&str, &str)]) -> BTreeMap<String, RefOr<ApiResponse>> {
    of.iter()
        .map(|(status, description)| {
            let content =
                ContentBuilder::new().schema(Some(RefOr::Ref(utoipa::openapi::Ref::from_schema_name("Problem"))));
            let response = ResponseBuilder::new()
                .description(*description)
                .content("application/problem+json", content.build())
                .build();
            ((*status).to_owned(), RefOr::T(response))
        })
        .collect()
}

const READ: [(&str, &str); 8] = [
    ("400", "Path, query or header cannot be understood"),
    ("401", "No valid access token"),
    ("403", "The role of the token does not suffice"),
    ("404", "No such resource"),
    ("410", "It was there and was removed"),
    ("408", "The request took too long to arrive"),
    ("500", "The service failed"),
    ("503", "The service is busy; see Retry-After"),
];

const WRITE: [(&str, &str); 5] = [
    ("409", "The request contradicts what is there"),
    ("413", "The body is too large"),
    ("415", "The body is of a type that is not taken"),
    ("422", "A value lies outside its interval or refers to nothing"),
    ("507", "The disk or the quota of the ropeway has no room; see Retry-After"),
];

impl IntoResponses for ReadProblems {
    fn responses() -> BTreeMap<String, RefOr<ApiResponse>> {
        let mut all = problems(&READ);
        all.extend(problems(&WRITE[3..4]));
        all
    }
}

impl IntoResponses for WriteProblems {
    fn responses() -> BTreeMap<String, RefOr<ApiResponse>> {
        let mut all = problems(&READ);
        all.extend(problems(&WRITE));
        all
    }
}

/// Schema of [`Problem`] for the contract.
pub fn schema() -> (String, RefOr<utoipa::openapi::Schema>) {
    ("Problem".to_owned(), Problem::schema())
}
