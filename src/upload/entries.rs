//! Frames as they are announced and sent: packed, digested, one by one.

use super::client::Client;
use super::journal::{Digested, Journal};
use super::packing::{Packed, Packing};
use super::plan::{Plan, PlanError, PlannedFrame};
use super::upload_error::UploadError;
use crate::store::digest::hex;
use base64::Engine;
use futures::StreamExt;
use reqwest::Method;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use uuid::Uuid;

/// View, number, file and how it is sent.
pub(super) struct Entry {
    pub view: usize,
    pub number: usize,
    pub frame: PlannedFrame,
    pub digested: Digested,
}

impl Entry {
    /// The frame as a manifest names it.
    pub fn announcement(&self) -> Value {
        let d = &self.digested;
        json!({"view": self.view, "frame": self.number, "sha256": d.sha256, "bytes": d.bytes, "lines": d.lines})
    }
}

/// Where frames are announced.
pub(super) fn manifest_path(acquisition_id: Uuid) -> String {
    format!("/acquisitions/{acquisition_id}/manifest")
}

/// Digests of frames: from the journal, else computed on all cores.
pub(super) async fn digests(
    journal: &mut Journal,
    packing: Packing,
    batch: &[(usize, usize, PlannedFrame)],
) -> Result<Vec<Entry>, UploadError> {
    let name = packing.name();
    let work = batch.iter().cloned().map(|(view, number, frame)| {
        let known = journal.digested(view, number, frame.bytes, frame.modified_ms, &name).cloned();
        let name = name.clone();
        async move {
            let digested = match known {
                Some(digested) => digested,
                None => {
                    let packed = pack(packing, &frame).await?;
                    Digested {
                        source_bytes: frame.bytes,
                        modified_ms: frame.modified_ms,
                        packing: name,
                        sha256: hex(&Sha256::digest(&packed.bytes)),
                        bytes: packed.bytes.len() as u64,
                        lines: packed.lines,
                    }
                }
            };
            Ok::<_, UploadError>(Entry { view, number, frame, digested })
        }
    });
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    let entries: Vec<_> = futures::stream::iter(work.collect::<Vec<_>>()).buffered(cores).collect().await;
    let entries = entries.into_iter().collect::<Result<Vec<_>, _>>()?;
    for e in &entries {
        let d = &e.digested;
        if journal.digested(e.view, e.number, d.source_bytes, d.modified_ms, &name).is_none() {
            journal.keep(e.view, e.number, d.clone());
        }
    }
    Ok(entries)
}

/// Frames of which `known` (by view and number) says no, all views side by side: the rope is whole as far as it was sent.
pub(super) fn in_turn(plan: &Plan, known: impl Fn(usize, usize) -> bool) -> Vec<(usize, usize, PlannedFrame)> {
    let longest = plan.frames.iter().map(Vec::len).max().unwrap_or(0);
    let places = (0..longest).flat_map(|number| (0..plan.frames.len()).map(move |view| (view, number)));
    places
        .filter(|&(view, number)| !known(view, number))
        .filter_map(|(view, number)| Some((view, number, plan.frames[view].get(number)?.clone())))
        .collect()
}

/// Packs off the async threads.
pub(super) async fn pack(packing: Packing, frame: &PlannedFrame) -> Result<Packed, UploadError> {
    let path = frame.path.clone();
    let packed = tokio::task::spawn_blocking(move || packing.pack(&path)).await;
    let died = |e: tokio::task::JoinError| PlanError::Frame { path: frame.path.clone(), reason: e.to_string() };
    Ok(packed.map_err(died)??)
}

/// Sends one frame with its digest. Returns its length, or `None` when another request is bringing the same frame.
pub(super) async fn send_frame(
    client: &Client,
    packing: Packing,
    acquisition_id: Uuid,
    entry: &Entry,
) -> Result<Option<u64>, UploadError> {
    let packed = pack(packing, &entry.frame).await?;
    let headers = headers(&packed.bytes, packed.content_type);
    let length = packed.bytes.len() as u64;
    let path = format!("/acquisitions/{acquisition_id}/views/{}/frames/{}", entry.view, entry.number);
    // A frame may have arrived although its answer was lost: asking costs less than sending it again.
    let manifest = json!({"frames": [entry.announcement()]});
    let arrived = async || {
        let answer = client.try_post(&manifest_path(acquisition_id), &manifest).await;
        answer.is_some_and(|answer| answer["to_send"].as_array().is_some_and(Vec::is_empty))
    };
    match client.send_unless(Method::PUT, &path, &headers, packed.bytes, arrived).await {
        Ok(_) => Ok(Some(length)),
        Err(error) if error.is_problem("superseded") => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// What is said of a body: its digest and its type.
pub(super) fn headers(body: &[u8], content_type: &str) -> [(&'static str, String); 2] {
    let digest = base64::engine::general_purpose::STANDARD.encode(Sha256::digest(body));
    [("repr-digest", format!("sha-256=:{digest}:")), ("content-type", content_type.to_owned())]
}
