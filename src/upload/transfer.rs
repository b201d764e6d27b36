//! Brings the frames of a plan to a service: announces all of them, sends what the service does not hold, completes.

use super::client::{Client, ClientError};
use super::journal::{Digested, Journal};
use super::lanes::Lanes;
use super::packing::{Packed, Packing};
use super::place;
use super::plan::{Plan, PlanError, PlannedFrame};
use super::progress::{Counter, Stage, Tick};
use crate::store::digest::hex;
use base64::Engine;
use futures::StreamExt;
use reqwest::Method;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::time::Duration;
use uuid::Uuid;

/// Frames that are announced in one request.
const ANNOUNCED_AT_ONCE: usize = 500;
/// How often the list of missing frames is asked for anew when a completion was refused: another client may be sending, and
/// frames may be found damaged.
const ROUNDS: u32 = 20;
/// Wait between them.
const ROUND_WAIT: Duration = Duration::from_secs(2);

/// How to upload.
#[derive(Debug, Clone)]
pub struct Options {
    /// Most frames on their way at the same time.
    pub connections: usize,
    /// Bits of a gray value in camera dumps, 8 or 16.
    pub raw_bits: u8,
    /// Compress frames before they are sent.
    pub compress: bool,
    /// Wait for the receipt.
    pub receipt: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { connections: 8, raw_bits: 8, compress: false, receipt: false }
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
    /// The receipt, if it was asked for.
    pub receipt: Option<Value>,
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

/// View, number, file and how it is sent.
struct Entry {
    view: usize,
    number: usize,
    frame: PlannedFrame,
    digested: Digested,
}

impl Entry {
    /// The frame as a manifest names it.
    fn announcement(&self) -> Value {
        let d = &self.digested;
        json!({"view": self.view, "frame": self.number, "sha256": d.sha256, "bytes": d.bytes, "lines": d.lines})
    }
}

fn manifest_path(acquisition_id: Uuid) -> String {
    format!("/acquisitions/{acquisition_id}/manifest")
}

/// An upload that is under way.
pub struct Transfer<F> {
    client: Client,
    packing: Packing,
    lanes: Lanes,
    connections: usize,
    wants_receipt: bool,
    ropeway_id: Uuid,
    rope_id: Uuid,
    /// The acquisition.
    pub acquisition_id: Uuid,
    journal: Journal,
    held: BTreeSet<(usize, usize)>,
    sent_frames: usize,
    counter: Counter,
    on_tick: F,
}

/// Uploads a whole recording. `on_tick` is called when it begins and after every frame.
pub async fn upload<F: Fn(&Tick)>(
    client: &Client,
    plan: &Plan,
    options: &Options,
    on_tick: F,
) -> Result<Report, UploadError> {
    let begin = plan.begin()?.unwrap_or_default(); // a whole recording has frames
    let mut transfer = Transfer::begin(client, plan, &begin, options, on_tick).await?;
    transfer.bring(plan).await?;
    transfer.complete(plan).await
}

impl<F: Fn(&Tick)> Transfer<F> {
    /// Finds or creates ropeway, rope and acquisition.
    pub async fn begin(
        client: &Client,
        plan: &Plan,
        begin: &str,
        options: &Options,
        on_tick: F,
    ) -> Result<Self, UploadError> {
        let ropeway_id = place::ropeway(client, plan).await?;
        let rope_id = place::rope(client, plan, ropeway_id).await?;
        let mut journal = Journal::open(&plan.folder);
        let fresh = plan.acquisition_id(rope_id, begin)?;
        let acquisition_id = journal.acquisition_id(begin, rope_id, || fresh);
        client.put(&format!("/acquisitions/{acquisition_id}"), &plan.acquisition(rope_id)).await?;
        let lanes = Lanes::new(options.connections);
        let told = lanes.clone();
        Ok(Self {
            client: client.clone().telling(move |_, _| told.failed()),
            packing: Packing { raw_width_px: plan.sensor_px, raw_bits: options.raw_bits, compress: options.compress },
            lanes,
            connections: options.connections.max(1),
            wants_receipt: options.receipt,
            ropeway_id,
            rope_id,
            acquisition_id,
            journal,
            held: BTreeSet::new(),
            sent_frames: 0,
            counter: Counter::begin(plan.frames.len()),
            on_tick,
        })
    }

    /// Announces every frame of the plan that is not known to be held, and sends those that the service asks for.
    pub async fn bring(&mut self, plan: &Plan) -> Result<(), UploadError> {
        self.counter.found(plan.frames.iter().map(Vec::len));
        self.enter(Stage::Announcing);
        let mut wanted = Vec::new();
        for batch in in_turn(plan, &self.held).chunks(ANNOUNCED_AT_ONCE) {
            wanted.extend(self.announce(batch).await?);
        }
        self.enter(Stage::Sending);
        self.send(wanted).await
    }

    /// Tells that nothing is to do until the recording grows.
    pub fn rest(&mut self) {
        self.enter(Stage::Watching);
    }

    /// Says that all was sent; sends again what the service misses then.
    pub async fn complete(mut self, plan: &Plan) -> Result<Report, UploadError> {
        let path = format!("/acquisitions/{}/completion", self.acquisition_id);
        let mut rounds = 0;
        loop {
            self.send_missing(plan).await?;
            rounds += 1;
            match self.client.post(&path, &plan.completion()).await {
                Err(error) if error.is_problem("acquisition-incomplete") && rounds < ROUNDS => {
                    tokio::time::sleep(ROUND_WAIT).await;
                }
                answer => {
                    answer?;
                    break;
                }
            }
        }
        let receipt = if self.wants_receipt { Some(self.receipt(plan).await?) } else { None };
        Ok(Report {
            ropeway_id: self.ropeway_id,
            rope_id: self.rope_id,
            acquisition_id: self.acquisition_id,
            frames: plan.frame_count(),
            sent_frames: self.sent_frames,
            sent_bytes: self.counter.sent_bytes(),
            seconds: self.counter.seconds(),
            receipt,
        })
    }

    pub(super) fn client(&self) -> &Client {
        &self.client
    }

    fn enter(&mut self, stage: Stage) {
        self.counter.enter(stage);
        self.tick();
    }

    fn tick(&mut self) {
        (self.on_tick)(&self.counter.tick(self.lanes.allowed()));
    }

    /// Announces frames and returns those that have to be sent.
    async fn announce(&mut self, batch: &[(usize, usize, PlannedFrame)]) -> Result<Vec<Entry>, UploadError> {
        let mut entries = self.digests(batch).await?;
        let frames: Vec<Value> = entries.iter().map(Entry::announcement).collect();
        let answer = self.client.post(&manifest_path(self.acquisition_id), &json!({"frames": frames})).await?;
        let asked = answer["to_send"].as_array().map(Vec::as_slice).unwrap_or_default();
        let number = |value: &Value| value.as_u64().unwrap_or(u64::MAX) as usize;
        let asked: BTreeSet<(usize, usize)> = asked.iter().map(|f| (number(&f["view"]), number(&f["frame"]))).collect();
        for entry in &entries {
            if !asked.contains(&(entry.view, entry.number)) && self.held.insert((entry.view, entry.number)) {
                self.counter.held(entry.view, 0);
            }
        }
        entries.retain(|e| asked.contains(&(e.view, e.number)));
        self.counter.to_send(entries.iter().map(|e| e.digested.bytes).sum());
        self.tick();
        Ok(entries)
    }

    /// Digests of frames: from the journal, else computed on all cores.
    async fn digests(&mut self, batch: &[(usize, usize, PlannedFrame)]) -> Result<Vec<Entry>, UploadError> {
        let (packing, name) = (self.packing, self.packing.name());
        let work = batch.iter().cloned().map(|(view, number, frame)| {
            let known = self.journal.digested(view, number, frame.bytes, frame.modified_ms, &name).cloned();
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
            if self.journal.digested(e.view, e.number, d.source_bytes, d.modified_ms, &name).is_none() {
                self.journal.keep(e.view, e.number, d.clone());
            }
        }
        Ok(entries)
    }

    /// Sends frames over as many lanes as the link bears.
    async fn send(&mut self, entries: Vec<Entry>) -> Result<(), UploadError> {
        let (client, lanes, packing, id) = (self.client.clone(), self.lanes.clone(), self.packing, self.acquisition_id);
        let mut answers = futures::stream::iter(entries)
            .map(|entry| {
                let (client, lanes) = (client.clone(), lanes.clone());
                async move {
                    let _lane = lanes.enter().await;
                    let sent = send_frame(&client, packing, id, &entry).await?;
                    if let Some(bytes) = sent {
                        lanes.succeeded(bytes);
                    }
                    Ok::<_, UploadError>((entry.view, entry.number, sent))
                }
            })
            .buffer_unordered(self.connections);
        while let Some(answer) = answers.next().await {
            let (view, number, sent) = answer?;
            // What another request brings is asked for again before completion.
            if let Some(bytes) = sent {
                self.sent_frames += 1;
                if self.held.insert((view, number)) {
                    self.counter.held(view, bytes);
                }
                (self.on_tick)(&self.counter.tick(lanes.allowed()));
            }
        }
        Ok(())
    }

    /// Sends what the service names as missing or damaged.
    pub(super) async fn send_missing(&mut self, plan: &Plan) -> Result<(), UploadError> {
        let path = format!("/acquisitions/{}/missing", self.acquisition_id);
        let answer = self.client.get(&path).await?;
        let bad = |reason: &str| ClientError::Answer { what: format!("GET {path}"), reason: reason.into() };
        let mut frames = Vec::new();
        for entry in answer["views"].as_array().ok_or_else(|| bad("no views"))? {
            let view = entry["view"].as_u64().ok_or_else(|| bad("a view without number"))? as usize;
            let mut numbers = Vec::new();
            for range in entry["missing"].as_array().ok_or_else(|| bad("a view without missing ranges"))? {
                let (Some(from), Some(to)) = (range[0].as_u64(), range[1].as_u64()) else {
                    return Err(bad("a range is not two numbers").into());
                };
                numbers.extend(from as usize..=to as usize);
            }
            let damaged = entry["damaged"].as_array().map(Vec::as_slice).unwrap_or_default();
            numbers.extend(damaged.iter().filter_map(Value::as_u64).map(|n| n as usize));
            for number in numbers {
                let frame = plan.frames.get(view).and_then(|v| v.get(number));
                let frame = frame.ok_or(UploadError::UnknownFrame { view, frame: number })?;
                frames.push((view, number, frame.clone()));
            }
        }
        for batch in frames.chunks(ANNOUNCED_AT_ONCE) {
            let wanted = self.announce(batch).await?;
            self.send(wanted).await?;
        }
        Ok(())
    }
}

/// Frames that are not held, all views side by side: the rope is whole as far as it was sent.
fn in_turn(plan: &Plan, held: &BTreeSet<(usize, usize)>) -> Vec<(usize, usize, PlannedFrame)> {
    let longest = plan.frames.iter().map(Vec::len).max().unwrap_or(0);
    let places = (0..longest).flat_map(|number| (0..plan.frames.len()).map(move |view| (view, number)));
    places
        .filter(|place| !held.contains(place))
        .filter_map(|(view, number)| Some((view, number, plan.frames[view].get(number)?.clone())))
        .collect()
}

async fn pack(packing: Packing, frame: &PlannedFrame) -> Result<Packed, UploadError> {
    let path = frame.path.clone();
    let packed = tokio::task::spawn_blocking(move || packing.pack(&path)).await;
    let died = |e: tokio::task::JoinError| PlanError::Frame { path: frame.path.clone(), reason: e.to_string() };
    Ok(packed.map_err(died)??)
}

/// Sends one frame with its digest. Returns its length, or `None` when another request is bringing the same frame.
async fn send_frame(
    client: &Client,
    packing: Packing,
    acquisition_id: Uuid,
    entry: &Entry,
) -> Result<Option<u64>, UploadError> {
    let packed = pack(packing, &entry.frame).await?;
    let digest = base64::engine::general_purpose::STANDARD.encode(Sha256::digest(&packed.bytes));
    let headers = [("repr-digest", format!("sha-256=:{digest}:")), ("content-type", packed.content_type.to_owned())];
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
