//! The one way requests are read: like axum's extractors, but what cannot be read is a [`Problem`].

use super::Problem;
use axum::extract::rejection::{JsonRejection, PathRejection, QueryRejection};
use axum::extract::{FromRequest, FromRequestParts};

/// A JSON body.
#[derive(FromRequest)]
#[from_request(via(axum::Json), rejection(Problem))]
pub struct Json<T>(pub T);

/// Query parameters.
#[derive(FromRequestParts)]
#[from_request(via(axum::extract::Query), rejection(Problem))]
pub struct Query<T>(pub T);

/// Parts of the path.
#[derive(FromRequestParts)]
#[from_request(via(axum::extract::Path), rejection(Problem))]
pub struct Path<T>(pub T);

impl From<JsonRejection> for Problem {
    fn from(rejection: JsonRejection) -> Self {
        let detail = rejection.body_text();
        match rejection {
            JsonRejection::MissingJsonContentType(_) => {
                Self::unsupported_media_type("the body must be application/json")
            }
            JsonRejection::BytesRejection(_) if rejection.status() == 413 => Self::body_too_large(detail),
            JsonRejection::BytesRejection(_) => Self::body_cut_short(detail),
            JsonRejection::JsonDataError(_) | JsonRejection::JsonSyntaxError(_) => Self::malformed_body(detail),
            _ => Self::malformed_body(detail),
        }
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        Self::malformed_query(rejection.body_text())
    }
}

impl From<PathRejection> for Problem {
    fn from(rejection: PathRejection) -> Self {
        Self::malformed_path(rejection.body_text())
    }
}
