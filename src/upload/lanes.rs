//! How many frames are on their way at once: as many as make the link faster, fewer when it fails.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;

/// Frames at the beginning, and the fewest that failures leave: one lane cannot fill a link with delay, and while one hangs the others
/// go on.
const FIRST: usize = 4;
/// A comparison of speeds needs so many frames a lane ..
const FRAMES_A_LANE: usize = 2;
/// .. and so much time.
const WINDOW: Duration = Duration::from_secs(1);
/// One more lane must be worth so much.
const WORTH: f64 = 1.05;
/// After a lane that was not, so many windows pass before the next attempt: the link may have changed.
const REST_WINDOWS: u32 = 10;

struct State {
    allowed: usize,
    busy: usize,
    begun: Instant,
    frames: usize,
    bytes: u64,
    /// Speed with one lane less, bytes a second; `None` after a change that says nothing.
    before: Option<f64>,
    rest: u32,
    /// When a failure last took a lane.
    failed: Option<Instant>,
}

/// The lanes of an upload. Cheap to clone.
#[derive(Clone)]
pub struct Lanes {
    most: usize,
    state: Arc<Mutex<State>>,
    freed: Arc<Notify>,
}

/// The right to have one frame on its way.
pub struct Lane(Lanes);

impl Lanes {
    /// At most `most` lanes.
    pub fn new(most: usize) -> Self {
        let most = most.max(1);
        let state = State {
            allowed: FIRST.min(most),
            busy: 0,
            begun: Instant::now(),
            frames: 0,
            bytes: 0,
            before: None,
            rest: 0,
            failed: None,
        };
        Self { most, state: Arc::new(Mutex::new(state)), freed: Arc::default() }
    }

    /// Waits for a lane.
    pub async fn enter(&self) -> Lane {
        loop {
            let freed = self.freed.notified(); // before looking, or a lane freed in between is missed
            {
                let mut state = self.state();
                if state.busy < state.allowed {
                    state.busy += 1;
                    return Lane(self.clone());
                }
            }
            freed.await;
        }
    }

    /// How many lanes there are now.
    pub fn allowed(&self) -> usize {
        self.state().allowed
    }

    /// A frame was acknowledged: now and then the number of lanes is judged by what it brought.
    pub fn succeeded(&self, bytes: u64) {
        let mut state = self.state();
        state.frames += 1;
        state.bytes += bytes;
        let elapsed = state.begun.elapsed();
        if state.frames >= FRAMES_A_LANE * state.allowed && elapsed >= WINDOW {
            let speed = state.bytes as f64 / elapsed.as_secs_f64();
            state.judge(speed, self.most);
            state.begin_window();
        }
        self.freed.notify_waiters();
    }

    /// A request failed: perhaps the link has less room than thought. A lane less, but only one for failures that come together: when
    /// a link is cut, all lanes hear of it, and it has as much room as before when it is back.
    pub fn failed(&self) {
        let mut state = self.state();
        if state.failed.is_none_or(|when| when.elapsed() >= WINDOW) {
            state.allowed = (state.allowed - 1).max(FIRST.min(self.most));
            state.failed = Some(Instant::now());
            state.before = None;
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner) // numbers only: nothing is half done
    }
}

impl State {
    fn judge(&mut self, speed: f64, most: usize) {
        match self.before {
            _ if self.rest > 0 => self.rest -= 1,
            Some(before) if speed < before * WORTH => {
                self.allowed = (self.allowed - 1).max(1);
                self.before = None;
                self.rest = REST_WINDOWS;
            }
            _ if self.allowed < most => {
                self.before = Some(speed);
                self.allowed += 1;
            }
            _ => self.before = None,
        }
    }

    fn begin_window(&mut self) {
        self.begun = Instant::now();
        self.frames = 0;
        self.bytes = 0;
    }
}

impl Drop for Lane {
    fn drop(&mut self) {
        self.0.state().busy -= 1;
        self.0.freed.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lanes after `windows` comparisons on a link with this speed for each number of lanes.
    fn settled(speed: impl Fn(usize) -> f64, windows: usize) -> usize {
        let lanes = Lanes::new(16);
        let mut state = lanes.state();
        for _ in 0..windows {
            let now = speed(state.allowed);
            state.judge(now, 16);
        }
        state.allowed
    }

    #[test]
    fn lanes_grow_while_they_make_the_link_faster() {
        assert_eq!(settled(|n| 1e6 * n as f64, 40), 16);
        let full_with_5 = settled(|n| 1e6 * n.min(5) as f64, 40);
        assert!((5..=6).contains(&full_with_5), "{full_with_5}");
    }

    #[test]
    fn failures_that_come_together_cost_one_lane_and_some_always_remain() {
        let lanes = Lanes::new(8);
        lanes.state().allowed = 6;
        for (at_once, expected) in [(5, 5), (1, 4), (3, 4)] {
            (0..at_once).for_each(|_| lanes.failed());
            assert_eq!(lanes.allowed(), expected);
            lanes.state().failed = Instant::now().checked_sub(WINDOW);
        }
        let few = Lanes::new(2);
        few.failed();
        assert_eq!(few.allowed(), 2);
    }

    #[tokio::test]
    async fn no_more_frames_are_on_their_way_than_lanes_are_allowed() {
        let lanes = Lanes::new(2);
        let first = lanes.enter().await;
        let _second = lanes.enter().await;
        assert!(tokio::time::timeout(Duration::from_millis(50), lanes.enter()).await.is_err());
        drop(first);
        assert!(tokio::time::timeout(Duration::from_secs(5), lanes.enter()).await.is_ok());
    }
}
