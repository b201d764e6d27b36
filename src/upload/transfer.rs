//! Brings the frames of a plan to a service: announces all of them, sends what the service does not hold, completes.

use super::client::Client;
use super::entries::{Entry, digests, in_turn, manifest_path, send_frame};
use super::journal::Journal;
use super::lanes::Lanes;
use super::packing::Packing;
use super::place;
use super::plan::{Plan, PlannedFrame};
use super::progress::{Counter, Stage, Tick};
use super::upload_error::UploadError;
use futures::StreamExt;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;
use uuid::Uuid;

/// Frames that are announced in one request.
pub(super) const ANNOUNCED_AT_ONCE: usize = 500;
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
    /// Send a reduced form of all frames first, then the frames in the order in which the service wants them.
    pub preview_first: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { connections: 8, raw_bits: 8, compress: false, receipt: false, preview_first: false }
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
    /// Bytes of these.
    pub sent_bytes: u64,
    /// Previews that this run sent before the frames.
    pub sent_previews: usize,
    /// Bytes of these.
    pub preview_bytes: u64,
    /// Seconds of the run.
    pub seconds: f64,
    /// The receipt, if it was asked for.
    pub receipt: Option<Value>,
}

/// An upload that is under way.
pub struct Transfer<F> {
    pub(super) client: Client,
    pub(super) packing: Packing,
    pub(super) lanes: Lanes,
    pub(super) connections: usize,
    wants_receipt: bool,
    preview_first: bool,
    ropeway_id: Uuid,
    rope_id: Uuid,
    /// The acquisition.
    pub acquisition_id: Uuid,
    journal: Journal,
    held: BTreeSet<(usize, usize)>,
    /// Frames that were announced and have to be sent, by number and view.
    pub(super) backlog: BTreeMap<(usize, usize), Entry>,
    /// Camera lines of every frame that was announced.
    pub(super) lines: BTreeMap<(usize, usize), u32>,
    sent_frames: usize,
    pub(super) counter: Counter,
    pub(super) on_tick: F,
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
            preview_first: options.preview_first,
            ropeway_id,
            rope_id,
            acquisition_id,
            journal,
            held: BTreeSet::new(),
            backlog: BTreeMap::new(),
            lines: BTreeMap::new(),
            sent_frames: 0,
            counter: Counter::begin(plan.frames.len()),
            on_tick,
        })
    }

    /// Announces every frame of the plan that is not known to be held, and sends those that the service asks for.
    pub async fn bring(&mut self, plan: &Plan) -> Result<(), UploadError> {
        self.announce_new(plan).await?;
        while !self.send_some().await? {}
        Ok(())
    }

    /// Announces the frames of the plan that are neither held nor waiting to be sent; the previews of those that the service asks
    /// for go out at once, if previews go first.
    pub async fn announce_new(&mut self, plan: &Plan) -> Result<(), UploadError> {
        self.counter.found(plan.frames.iter().map(Vec::len));
        self.enter(Stage::Announcing);
        let known = |view, number| self.held.contains(&(view, number)) || self.backlog.contains_key(&(number, view));
        let mut asked = false;
        for batch in in_turn(plan, known).chunks(ANNOUNCED_AT_ONCE) {
            for entry in self.announce(batch).await? {
                asked = true;
                self.backlog.insert((entry.number, entry.view), entry);
            }
        }
        if self.preview_first && asked {
            self.enter(Stage::Previewing);
            self.send_previews(plan).await?;
        }
        Ok(())
    }

    /// Sends what waits: all of it along the rope or, if previews go first, the frames that the service wants most. True when nothing
    /// waits any more.
    pub async fn send_some(&mut self) -> Result<bool, UploadError> {
        self.enter(Stage::Sending);
        let next = if self.preview_first {
            self.wanted_most().await?
        } else {
            std::mem::take(&mut self.backlog).into_values().collect()
        };
        self.send(next).await?;
        Ok(self.backlog.is_empty())
    }

    /// The recording has ended: tells how many frames there are, where somebody waits for that before the completion.
    pub async fn ends_with(&mut self, plan: &Plan) -> Result<(), UploadError> {
        if self.preview_first {
            let path = format!("/acquisitions/{}", self.acquisition_id);
            self.client.put(&path, &plan.acquisition(self.rope_id)).await?;
        }
        Ok(())
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
            sent_previews: self.counter.sent_previews(),
            preview_bytes: self.counter.preview_bytes(),
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

    pub(super) fn tick(&mut self) {
        (self.on_tick)(&self.counter.tick(self.lanes.allowed()));
    }

    /// Announces frames and returns those that have to be sent.
    pub(super) async fn announce(&mut self, batch: &[(usize, usize, PlannedFrame)]) -> Result<Vec<Entry>, UploadError> {
        let mut entries = digests(&mut self.journal, self.packing, batch).await?;
        let frames: Vec<Value> = entries.iter().map(Entry::announcement).collect();
        let answer = self.client.post(&manifest_path(self.acquisition_id), &json!({"frames": frames})).await?;
        let asked = answer["to_send"].as_array().map(Vec::as_slice).unwrap_or_default();
        let number = |value: &Value| value.as_u64().unwrap_or(u64::MAX) as usize;
        let asked: BTreeSet<(usize, usize)> = asked.iter().map(|f| (number(&f["view"]), number(&f["frame"]))).collect();
        for entry in &entries {
            let first_time = self.lines.insert((entry.view, entry.number), entry.digested.lines).is_none();
            if first_time && asked.contains(&(entry.view, entry.number)) {
                self.counter.to_send(entry.view, entry.digested.bytes);
            }
            if !asked.contains(&(entry.view, entry.number)) && self.held.insert((entry.view, entry.number)) {
                self.counter.held(entry.view, 0);
            }
        }
        entries.retain(|e| asked.contains(&(e.view, e.number)));
        self.tick();
        Ok(entries)
    }

    /// Sends frames over as many lanes as the link bears.
    pub(super) async fn send(&mut self, entries: Vec<Entry>) -> Result<(), UploadError> {
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
}
