//! Creates what is not there, asks what is missing, sends it over several connections, completes the acquisition.

use super::client::{Client, ClientError};
use super::plan::{Plan, PlanError, PlannedFrame};
use base64::Engine;
use futures::StreamExt;
use reqwest::Method;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::time::Instant;
use uuid::Uuid;

/// How to upload.
#[derive(Debug, Clone)]
pub struct Options {
    /// Frames on their way at the same time.
    pub connections: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { connections: 4 }
    }
}

/// Where an upload stands, told after every frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tick {
    /// Frames of the acquisition.
    pub frames: usize,
    /// Frames that the service holds.
    pub held: usize,
    /// Bytes that this run has to send.
    pub bytes: u64,
    /// Bytes that this run has sent.
    pub sent_bytes: u64,
    /// Seconds since sending began.
    pub seconds: f64,
}

impl Tick {
    /// MB (10^6 bytes) per second so far.
    pub fn mb_per_second(&self) -> f64 {
        if self.seconds > 0.0 { self.sent_bytes as f64 / 1e6 / self.seconds } else { 0.0 }
    }

    /// Seconds left at the speed so far; `None` before the first byte.
    pub fn seconds_left(&self) -> Option<f64> {
        let left = self.bytes.saturating_sub(self.sent_bytes) as f64;
        (self.sent_bytes > 0).then(|| left * self.seconds / self.sent_bytes as f64)
    }
}

/// What an upload did.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Report {
    /// The ropeway.
    pub ropeway_id: Uuid,
    /// The rope.
    pub rope_id: Uuid,
    /// The acquisition, complete now.
    pub acquisition_id: Uuid,
    /// Frames of the acquisition.
    pub frames: usize,
    /// Frames that this run sent; the service held the others.
    pub sent_frames: usize,
    /// Bytes that this run sent.
    pub sent_bytes: u64,
    /// Seconds of the run.
    pub seconds: f64,
}

/// Why an upload ended early. What was sent stays sent: a rerun continues.
#[derive(Debug, thiserror::Error)]
pub enum UploadError {
    /// The folder cannot be uploaded.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The service did not play along.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The service knows the rope by other data.
    #[error(
        "the rope {rope:?} on ropeway {ropeway:?} has {quantity} {held} at the service, but rope.json says {ours}: correct rope.json, or give the rope another name with --rope"
    )]
    OtherDesign {
        /// Name of the ropeway.
        ropeway: String,
        /// Name of the rope.
        rope: String,
        /// What differs.
        quantity: &'static str,
        /// The value there.
        held: Value,
        /// The value here.
        ours: Value,
    },
    /// The frames that the service names as missing are not in the folder.
    #[error("the service misses view {view} frame {frame}, which is not in this folder")]
    UnknownFrame {
        /// The view.
        view: usize,
        /// The frame.
        frame: usize,
    },
}

/// Uploads `plan`. `tick` is called at the start and after every frame.
pub async fn upload(
    client: &Client,
    plan: &Plan,
    options: &Options,
    tick: impl Fn(Tick) + Sync,
) -> Result<Report, UploadError> {
    let begun = Instant::now();
    let ropeway_id = ropeway(client, plan).await?;
    let rope_id = rope(client, plan, ropeway_id).await?;
    let acquisition_id = plan.acquisition_id(rope_id);
    client.put(&format!("/acquisitions/{acquisition_id}"), &plan.acquisition(rope_id)).await?;
    let missing = missing(client, plan, acquisition_id).await?;
    let sending = Instant::now();
    let mut state = Tick {
        frames: plan.frame_count(),
        held: plan.frame_count() - missing.len(),
        bytes: missing.iter().map(|m| m.2.bytes).sum(),
        sent_bytes: 0,
        seconds: 0.0,
    };
    tick(state);
    let sent_frames = missing.len();
    let mut answers = futures::stream::iter(missing)
        .map(|(view, number, frame)| send_frame(client, acquisition_id, view, number, frame))
        .buffer_unordered(options.connections.max(1));
    while let Some(sent) = answers.next().await {
        state.sent_bytes += sent?;
        state.held += 1;
        state.seconds = sending.elapsed().as_secs_f64();
        tick(state);
    }
    client.post(&format!("/acquisitions/{acquisition_id}/completion"), &plan.completion()).await?;
    Ok(Report {
        ropeway_id,
        rope_id,
        acquisition_id,
        frames: state.frames,
        sent_frames,
        sent_bytes: state.sent_bytes,
        seconds: begun.elapsed().as_secs_f64(),
    })
}

/// The ropeway of this name: found, or created under the id derived from the name.
async fn ropeway(client: &Client, plan: &Plan) -> Result<Uuid, UploadError> {
    if let Some(found) = find(client, "/ropeways?limit=200", &plan.ropeway).await? {
        return Ok(id_of(&found)?);
    }
    let id = plan.ropeway_id();
    client.put(&format!("/ropeways/{id}"), &json!({"name": plan.ropeway})).await?;
    Ok(id)
}

/// The rope of this name: found and compared, or created.
async fn rope(client: &Client, plan: &Plan, ropeway_id: Uuid) -> Result<Uuid, UploadError> {
    let Some(found) = find(client, &format!("/ropes?limit=200&ropeway_id={ropeway_id}"), &plan.rope).await? else {
        let id = plan.rope_id(ropeway_id);
        let body = json!({"ropeway_id": ropeway_id, "name": plan.rope, "design": plan.design});
        client.put(&format!("/ropes/{id}"), &body).await?;
        return Ok(id);
    };
    for quantity in ["strands", "wires_per_strand", "rope_diameter_mm"] {
        let (held, ours) = (&found["design"][quantity], &plan.design[quantity]);
        if held.as_f64() != ours.as_f64() {
            return Err(UploadError::OtherDesign {
                ropeway: plan.ropeway.clone(),
                rope: plan.rope.clone(),
                quantity,
                held: held.clone(),
                ours: ours.clone(),
            });
        }
    }
    Ok(id_of(&found)?)
}

/// Looks through a list, page by page, for an item of this name.
async fn find(client: &Client, list: &str, name: &str) -> Result<Option<Value>, ClientError> {
    let mut path = list.to_owned();
    loop {
        let page = client.get(&path).await?;
        let items = page["items"].as_array().map(Vec::as_slice).unwrap_or_default();
        if let Some(item) = items.iter().find(|item| item["name"] == name) {
            return Ok(Some(item.clone()));
        }
        match page["next_cursor"].as_str() {
            Some(cursor) => path = format!("{list}&cursor={cursor}"),
            None => return Ok(None),
        }
    }
}

fn id_of(item: &Value) -> Result<Uuid, ClientError> {
    let text = item["id"].as_str().unwrap_or_default();
    text.parse().map_err(|_| ClientError::Answer {
        what: "GET of a list".into(),
        reason: format!("an item has the id {text:?}, which is no UUID"),
    })
}

/// View, number and file of every frame that the service does not hold.
async fn missing(
    client: &Client,
    plan: &Plan,
    acquisition_id: Uuid,
) -> Result<Vec<(usize, usize, PlannedFrame)>, UploadError> {
    let path = format!("/acquisitions/{acquisition_id}/missing");
    let answer = client.get(&path).await?;
    let bad = |reason: &str| ClientError::Answer { what: format!("GET {path}"), reason: reason.into() };
    let mut frames = Vec::new();
    for entry in answer["views"].as_array().ok_or_else(|| bad("no views"))? {
        let view = entry["view"].as_u64().ok_or_else(|| bad("a view without number"))? as usize;
        for range in entry["missing"].as_array().ok_or_else(|| bad("a view without missing ranges"))? {
            let (Some(from), Some(to)) = (range[0].as_u64(), range[1].as_u64()) else {
                return Err(bad("a range is not two numbers").into());
            };
            for number in from as usize..=to as usize {
                let frame = plan.frames.get(view).and_then(|v| v.get(number));
                let frame = frame.ok_or(UploadError::UnknownFrame { view, frame: number })?;
                frames.push((view, number, frame.clone()));
            }
        }
    }
    Ok(frames)
}

/// Sends one frame with its digest. Returns its length.
async fn send_frame(
    client: &Client,
    acquisition_id: Uuid,
    view: usize,
    number: usize,
    frame: PlannedFrame,
) -> Result<u64, UploadError> {
    let content =
        tokio::fs::read(&frame.path).await.map_err(|source| PlanError::Read { path: frame.path.clone(), source })?;
    let digest = base64::engine::general_purpose::STANDARD.encode(Sha256::digest(&content));
    let tiff = frame.path.extension().is_some_and(|e| e != "png");
    let headers = [
        ("repr-digest", format!("sha-256=:{digest}:")),
        ("content-type", if tiff { "image/tiff" } else { "image/png" }.to_owned()),
    ];
    let length = content.len() as u64;
    let path = format!("/acquisitions/{acquisition_id}/views/{view}/frames/{number}");
    client.send(Method::PUT, &path, &headers, content.into()).await?;
    Ok(length)
}
