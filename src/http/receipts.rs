//! Signed documents: receipts, after which the originals of a recording may be deleted, and certificates of what was inspected.

use super::acquisitions;
use super::completion::incomplete;
use super::extract::Path;
use super::problem::{ReadProblems, WriteProblems};
use super::{Problem, inspections, times};
use crate::app::App;
use crate::pipeline::results::Summary;
use crate::store::acquisitions::Acquisition;
use crate::store::manifest::StoredView;
use crate::store::verification::Verified;
use crate::store::{Id, StoreError};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use utoipa::ToSchema;
use uuid::Uuid;

/// What a receipt says to the person who holds the originals.
const STATEMENT: &str = "The service has read every frame of this acquisition back from its disk, and every one had the SHA-256 that \
    was announced for it. The originals may be deleted.";

/// A JSON Web Signature (RFC 7515, flattened, EdDSA) with the signed document readable beside it.
#[derive(ToSchema)]
#[expect(dead_code, reason = "only its schema is used")]
pub struct SignedDocument {
    /// The document that was signed.
    #[schema(value_type = Object)]
    document: Value,
    /// Header with algorithm and public key, base64url.
    protected: String,
    /// The signed bytes, base64url.
    payload: String,
    /// The signature, base64url.
    signature: String,
}

/// How far the verification before a receipt is.
#[derive(Debug, Serialize, ToSchema)]
pub struct Verification {
    /// Frames that were read back.
    verified_frames: u64,
    /// Frames of the acquisition.
    frames: u64,
}

/// The key that signs receipts and certificates, as a JWK (RFC 8037).
#[derive(Debug, Serialize, ToSchema)]
pub struct PublicKey {
    /// Always `OKP`.
    kty: &'static str,
    /// Always `Ed25519`.
    crv: &'static str,
    /// The public key, base64url.
    x: String,
}

/// Verifications that run in this process, and how many frames they have read. Cheap to clone.
#[derive(Clone, Default)]
pub struct Verifications(Arc<Mutex<HashMap<Uuid, u64>>>);

impl Verifications {
    /// How many frames were read back, if a verification runs; else begins one, and its owner must end it.
    fn running_or_begin(&self, id: Uuid) -> Option<u64> {
        let mut running = self.table();
        let read = running.get(&id).copied();
        if read.is_none() {
            running.insert(id, 0);
        }
        read
    }

    fn table(&self) -> std::sync::MutexGuard<'_, HashMap<Uuid, u64>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner) // numbers only: nothing is half done
    }
}

/// Ask for the receipt of an acquisition: a signed document after which the originals may be deleted
///
/// The first call lets every frame be read back from the disk; repeat it until the answer is 200. A frame that is damaged is named
/// as missing and has to be sent again.
#[utoipa::path(post, path = "/acquisitions/{id}/receipt", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")),
    responses((status = 200, description = "The receipt", body = SignedDocument),
        (status = 202, description = "Frames are being read back", body = Verification), WriteProblems))]
pub async fn post_receipt(State(app): State<App>, Path(id): Path<Uuid>) -> Result<Response, Problem> {
    if let Some(body) = app.store.receipt(Id(id)).await? {
        return Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response());
    }
    let acquisition = acquisitions::load_with_frames(&app, id).await?;
    let missing = app.store.missing(Id(id)).await?.ok_or_else(|| Problem::no("acquisition", id))?;
    if !acquisition.complete() || missing.iter().any(|view| !view.whole()) {
        return Err(incomplete(id, missing));
    }
    let frames = acquisition.views.iter().map(|view| u64::from(view.frames_present)).sum();
    let verified_frames = match app.verifications.running_or_begin(id) {
        Some(read) => read,
        None => {
            tokio::spawn(verify(app.clone(), acquisition));
            0
        }
    };
    Ok((StatusCode::ACCEPTED, axum::Json(Verification { verified_frames, frames })).into_response())
}

async fn verify(app: App, acquisition: Acquisition) {
    let id = acquisition.row.id;
    let on_progress = |frames| {
        app.verifications.table().insert(id.0, frames);
    };
    let outcome = async {
        let verified = app.store.verify_frames(id, on_progress).await?;
        if verified.damaged.is_empty() {
            issue(&app, &acquisition, &verified).await
        } else {
            tracing::error!(acquisition = %id, damaged = verified.damaged.len(), "frames are damaged on the disk");
            app.store.mark_damaged(&verified.damaged, app.now_ms()).await
        }
    };
    if let Err(error) = outcome.await {
        tracing::error!(acquisition = %id, %error, "a verification failed; it begins anew when it is asked for");
    }
    app.verifications.table().remove(&id.0);
}

async fn issue(app: &App, acquisition: &Acquisition, verified: &Verified) -> Result<(), StoreError> {
    let row = &acquisition.row;
    let (rope, ropeway) = app.store.names_of(row.rope_id).await?;
    let now_ms = app.now_ms();
    let document = json!({
        "type": "receipt",
        "statement": STATEMENT,
        "service": &*app.base_url,
        "acquisition_id": row.id.0,
        "rope_id": row.rope_id.0,
        "rope": rope,
        "ropeway": ropeway,
        "frames": verified.frames,
        "bytes": verified.bytes,
        "manifest_sha256": app.store.manifest_digest(row.id).await?,
        "views": views(&app.store.stored_views(row.id).await?, acquisition),
        "issued_at": times::rfc3339(now_ms),
    });
    let signed = app.store.signing_key().await?.sign(document);
    app.store.keep_receipt(row.id, &signed.to_string(), now_ms).await
}

fn views(stored: &[StoredView], acquisition: &Acquisition) -> Vec<Value> {
    let row = &acquisition.row;
    let views = stored.iter().map(|view| {
        let metres = view.lines as f64 * row.line_pitch_mm / 1000.0;
        json!({"view": view.view, "frames": view.frames, "bytes": view.bytes, "lines": view.lines,
               "from_m": row.start_m, "to_m": row.start_m + metres})
    });
    views.collect()
}

/// The certificate of what an inspection saw: metres of every view that were usable, and which were not and why
#[utoipa::path(get, path = "/inspections/{id}/coverage-certificate", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection")),
    responses((status = 200, description = "The signed certificate", body = SignedDocument), ReadProblems))]
pub async fn get_certificate(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Value>, Problem> {
    let inspection = inspections::load(&app, id).await?;
    let acquisition = acquisitions::load(&app, inspection.acquisition_id.0).await?;
    let summary: Summary = serde_json::from_str(&inspection.summary).map_err(Problem::failure)?;
    let (rope, ropeway) = app.store.names_of(inspection.rope_id).await?;
    let mut views = Vec::new();
    for view in app.store.stored_views(acquisition.row.id).await? {
        let not_usable: Vec<_> = summary.not_covered.iter().filter(|n| n.view == view.view as usize).collect();
        let seen_m = view.lines as f64 * acquisition.row.line_pitch_mm / 1000.0;
        let not_usable_m: f64 = not_usable.iter().map(|n| n.to_m - n.from_m).sum();
        views.push(json!({"view": view.view, "seen_m": seen_m, "usable_m": (seen_m - not_usable_m).max(0.0), "not_usable": not_usable}));
    }
    let document = json!({
        "type": "coverage-certificate",
        "statement": "Metres of rope times views. What was not usable was not inspected: it is not known to be intact.",
        "service": &*app.base_url,
        "inspection_id": inspection.id.0,
        "acquisition_id": inspection.acquisition_id.0,
        "rope_id": inspection.rope_id.0,
        "rope": rope,
        "ropeway": ropeway,
        "model_id": inspection.model_id.map(|model| model.0),
        "ropescope_version": summary.ropescope_version,
        "acquired_at": acquisition.row.acquired_at_ms.map(times::rfc3339),
        "inspected_at": times::rfc3339(inspection.created_at_ms),
        "metres": summary.metres,
        "usable_view_m": summary.covered_view_m,
        "views": views,
    });
    Ok(axum::Json(app.store.signing_key().await?.sign(document)))
}

/// The public key of receipts and certificates
#[utoipa::path(get, path = "/signing-key", tag = "service",
    responses((status = 200, description = "The key as JWK", body = PublicKey), ReadProblems))]
pub async fn get_signing_key(State(app): State<App>) -> Result<axum::Json<PublicKey>, Problem> {
    let x = app.store.signing_key().await?.public();
    Ok(axum::Json(PublicKey { kty: "OKP", crv: "Ed25519", x }))
}
