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

/// Where the upload of one view stands.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct ViewTick {
    /// Frames of the view.
    pub frames: usize,
    /// Frames that the service holds.
    pub held: usize,
    /// Bytes of frames that this run has to send, as far as it is known.
    pub bytes: u64,
    /// Bytes of frames that this run has sent and the service has acknowledged.
    pub sent_bytes: u64,
    /// MB (10^6 bytes) per second, lately: the share of the link that this view has.
    pub mb_per_second: f64,
}

impl ViewTick {
    /// Seconds left at the present speed; `None` while that is not known.
    pub fn seconds_left(&self) -> Option<f64> {
        seconds_left(self.bytes, self.sent_bytes, self.mb_per_second)
    }
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
        seconds_left(self.bytes, self.sent_bytes, self.mb_per_second)
    }
}

fn seconds_left(bytes: u64, sent_bytes: u64, mb_per_second: f64) -> Option<f64> {
    let left = bytes.saturating_sub(sent_bytes) as f64;
    match left {
        0.0 => Some(0.0),
        _ => (mb_per_second > 0.0).then(|| left / 1e6 / mb_per_second),
    }
}

/// Bytes that were acknowledged.
struct Acknowledged {
    when: Instant,
    /// Of a frame of this view; `None`: of a preview.
    view: Option<usize>,
    bytes: u64,
}

/// Counts what an upload does.
pub struct Counter {
    begun: Instant,
    stage: Stage,
    views: Vec<ViewTick>,
    previews: usize,
    sent_previews: usize,
    preview_bytes: u64,
    recent: VecDeque<Acknowledged>,
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

    /// So many bytes of a view will have to be sent.
    pub fn to_send(&mut self, view: usize, bytes: u64) {
        if let Some(view) = self.views.get_mut(view) {
            view.bytes += bytes;
        }
    }

    /// The service holds a frame, which took `bytes` just now (0: it held it before).
    pub fn held(&mut self, view: usize, bytes: u64) {
        if let Some(view) = self.views.get_mut(view) {
            view.held = (view.held + 1).min(view.frames);
            view.sent_bytes += bytes;
        }
        if bytes > 0 {
            self.recent.push_back(Acknowledged { when: Instant::now(), view: Some(view), bytes });
        }
    }

    /// The service holds so many previews.
    pub fn previews_held(&mut self, previews: usize) {
        self.previews = previews;
    }

    /// The service holds one more preview, which took `bytes` just now (0: it held it before).
    pub fn previewed(&mut self, bytes: u64) {
        self.previews += 1;
        if bytes > 0 {
            self.sent_previews += 1;
            self.preview_bytes += bytes;
            self.recent.push_back(Acknowledged { when: Instant::now(), view: None, bytes });
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
        self.views.iter().map(|v| v.sent_bytes).sum()
    }

    /// Seconds since it began.
    pub fn seconds(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Where the upload stands.
    pub fn tick(&mut self, connections: usize) -> Tick {
        while self.recent.front().is_some_and(|a| a.when.elapsed() > RECENT) {
            self.recent.pop_front();
        }
        let since_s = self.begun.elapsed().min(RECENT).as_secs_f64().max(0.001);
        let speed = |of: &dyn Fn(&Acknowledged) -> bool| {
            self.recent.iter().filter(|a| of(a)).map(|a| a.bytes).sum::<u64>() as f64 / 1e6 / since_s
        };
        let view = |(number, view): (usize, &ViewTick)| ViewTick {
            mb_per_second: speed(&|a| a.view == Some(number)),
            ..*view
        };
        Tick {
            stage: self.stage,
            frames: self.views.iter().map(|v| v.frames).sum(),
            held: self.views.iter().map(|v| v.held).sum(),
            previews: self.previews,
            bytes: self.views.iter().map(|v| v.bytes).sum(),
            sent_bytes: self.sent_bytes(),
            seconds: self.seconds(),
            mb_per_second: speed(&|_| true),
            views: self.views.iter().enumerate().map(view).collect(),
            connections,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_view_has_its_own_speed_and_time_left() {
        let mut counter = Counter::begin(3);
        counter.found([10, 10, 5].into_iter());
        counter.begun = Instant::now().checked_sub(Duration::from_secs(10)).unwrap();
        counter.to_send(0, 3_000_000);
        counter.to_send(1, 2_000_000);
        counter.held(0, 1_000_000);
        counter.held(1, 500_000);
        counter.previewed(4_000_000);
        let tick = counter.tick(4);
        // A million bytes in 10 s; what the test itself takes is lost in the tolerance.
        let near = |value: Option<f64>, expected: f64| (value.unwrap() - expected).abs() < 0.05 * expected;
        assert!(near(Some(tick.views[0].mb_per_second), 0.1) && near(Some(tick.views[1].mb_per_second), 0.05));
        assert!(near(tick.views[0].seconds_left(), 20.0) && near(tick.views[1].seconds_left(), 30.0), "{tick:?}");
        assert_eq!(tick.views[2].seconds_left(), Some(0.0), "nothing of it has to be sent");
        assert_eq!(format!("{:.2}", tick.views[2].mb_per_second), "0.00", "and not less than nothing");
        assert_eq!((tick.bytes, tick.sent_bytes), (5_000_000, 1_500_000));
        assert!(near(Some(tick.mb_per_second), 0.55), "previews move, too: {tick:?}");
    }
}
