//! Where an upload stands.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The speed is that of so much time: a link that was away for an hour is not slow for ever.
const RECENT: Duration = Duration::from_secs(30);

/// What an upload is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Frames are read, and the service is told what will come.
    Announcing,
    /// Reduced forms of the frames are sent, before the frames.
    Previewing,
    /// Frames are sent.
    Sending,
    /// Everything that is there was sent; the recording may still grow.
    Watching,
}

/// Frames of one view.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct ViewTick {
    /// Frames of the view.
    pub frames: usize,
    /// Frames that the service holds.
    pub held: usize,
}

/// Where an upload stands, told after every frame.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Tick {
    /// What it is doing.
    pub stage: Stage,
    /// Frames of the recording.
    pub frames: usize,
    /// Frames that the service holds.
    pub held: usize,
    /// The same for each view.
    pub views: Vec<ViewTick>,
    /// Previews that the service holds, if they were asked for.
    pub previews: usize,
    /// Bytes of frames that this run has to send, as far as it is known.
    pub bytes: u64,
    /// Bytes of frames that this run has sent and the service has acknowledged.
    pub sent_bytes: u64,
    /// Seconds since the run began.
    pub seconds: f64,
    /// MB (10^6 bytes) per second, lately.
    pub mb_per_second: f64,
    /// Frames that may be on their way at once, as the link bears it.
    pub connections: usize,
}

impl Tick {
    /// Seconds left at the present speed; `None` while that is not known.
    pub fn seconds_left(&self) -> Option<f64> {
        let left = self.bytes.saturating_sub(self.sent_bytes) as f64;
        (self.mb_per_second > 0.0).then(|| left / 1e6 / self.mb_per_second)
    }
}

/// Counts what an upload does.
pub struct Counter {
    begun: Instant,
    stage: Stage,
    views: Vec<ViewTick>,
    previews: usize,
    sent_previews: usize,
    preview_bytes: u64,
    bytes: u64,
    sent_bytes: u64,
    recent: VecDeque<(Instant, u64)>,
}

impl Counter {
    /// Nothing was done yet.
    pub fn begin(views: usize) -> Self {
        Self {
            begun: Instant::now(),
            stage: Stage::Announcing,
            views: vec![ViewTick::default(); views],
            previews: 0,
            sent_previews: 0,
            preview_bytes: 0,
            bytes: 0,
            sent_bytes: 0,
            recent: VecDeque::new(),
        }
    }

    /// Another stage begins.
    pub fn enter(&mut self, stage: Stage) {
        self.stage = stage;
    }

    /// The folder has so many frames of each view.
    pub fn found(&mut self, frames: impl Iterator<Item = usize>) {
        for (view, frames) in self.views.iter_mut().zip(frames) {
            view.frames = frames;
        }
    }

    /// So many bytes will have to be sent.
    pub fn to_send(&mut self, bytes: u64) {
        self.bytes += bytes;
    }

    /// The service holds a frame, which took `bytes` just now (0: it held it before).
    pub fn held(&mut self, view: usize, bytes: u64) {
        if let Some(view) = self.views.get_mut(view) {
            view.held = (view.held + 1).min(view.frames);
        }
        if bytes > 0 {
            self.sent_bytes += bytes;
            self.recent.push_back((Instant::now(), bytes));
        }
    }

    /// The service holds a preview, which took `bytes` just now (0: it held it before).
    pub fn previewed(&mut self, bytes: u64) {
        self.previews += 1;
        if bytes > 0 {
            self.sent_previews += 1;
            self.preview_bytes += bytes;
            self.recent.push_back((Instant::now(), bytes));
        }
    }

    /// Previews that were sent.
    pub fn sent_previews(&self) -> usize {
        self.sent_previews
    }

    /// Their bytes.
    pub fn preview_bytes(&self) -> u64 {
        self.preview_bytes
    }

    /// Bytes of frames that were sent.
    pub fn sent_bytes(&self) -> u64 {
        self.sent_bytes
    }

    /// Seconds since it began.
    pub fn seconds(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Where the upload stands.
    pub fn tick(&mut self, connections: usize) -> Tick {
        while self.recent.front().is_some_and(|(when, _)| when.elapsed() > RECENT) {
            self.recent.pop_front();
        }
        let since_s = self.begun.elapsed().min(RECENT).as_secs_f64().max(0.001);
        Tick {
            stage: self.stage,
            frames: self.views.iter().map(|v| v.frames).sum(),
            held: self.views.iter().map(|v| v.held).sum(),
            views: self.views.clone(),
            previews: self.previews,
            bytes: self.bytes,
            sent_bytes: self.sent_bytes,
            seconds: self.seconds(),
            mb_per_second: self.recent.iter().map(|(_, bytes)| *bytes as f64).sum::<f64>() / 1e6 / since_s,
            connections,
        }
    }
}
