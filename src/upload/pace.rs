//! Bodies that go out at a bounded speed and tell when they last moved.

use bytes::Bytes;
use futures::{Stream, StreamExt};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Bytes that go out at once.
const PIECE: usize = 32 << 10;

/// A speed that all bodies of a client share. Cheap to clone.
#[derive(Clone)]
pub struct Pace {
    bytes_per_second: Option<f64>,
    next: Arc<Mutex<Instant>>,
}

impl Pace {
    /// At most so many bytes a second; `None` for as many as the link takes.
    pub fn new(bytes_per_second: Option<f64>) -> Self {
        Self { bytes_per_second, next: Arc::new(Mutex::new(Instant::now())) }
    }

    /// Waits until `bytes` more may go out.
    async fn wait(&self, bytes: usize) {
        let Some(speed) = self.bytes_per_second else { return };
        let turn = {
            let mut next = self.next.lock().unwrap_or_else(PoisonError::into_inner);
            let turn = (*next).max(Instant::now());
            *next = turn + Duration::from_secs_f64(bytes as f64 / speed);
            turn
        };
        tokio::time::sleep_until(turn.into()).await;
    }

    /// `content` in pieces, each in its turn.
    pub fn body(&self, content: Bytes, motion: Motion) -> impl Stream<Item = std::io::Result<Bytes>> + use<> {
        let pace = self.clone();
        futures::stream::unfold((content, pace, motion), |(mut rest, pace, motion)| async {
            motion.moved();
            if rest.is_empty() {
                return None;
            }
            let piece = rest.split_to(PIECE.min(rest.len()));
            pace.wait(piece.len()).await;
            motion.moved();
            Some((Ok(piece), (rest, pace, motion)))
        })
        .boxed()
    }
}

/// When a request last moved. Cheap to clone.
#[derive(Clone)]
pub struct Motion(Arc<Mutex<Instant>>);

impl Motion {
    /// Begins now.
    pub fn begin() -> Self {
        Self(Arc::new(Mutex::new(Instant::now())))
    }

    /// It moves.
    pub fn moved(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Waits until it has not moved for `silence`.
    pub async fn rests(&self, silence: Duration) {
        loop {
            let last = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
            if last.elapsed() >= silence {
                return;
            }
            tokio::time::sleep_until((last + silence).into()).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn bodies_share_one_speed() {
        let pace = Pace::new(Some(1e6));
        let begun = Instant::now();
        let send = || pace.body(Bytes::from(vec![0; 150_000]), Motion::begin()).map(|p| p.unwrap().len());
        let (a, b) = tokio::join!(send().collect::<Vec<_>>(), send().collect::<Vec<_>>());
        assert_eq!(a.iter().chain(&b).sum::<usize>(), 300_000);
        // The last piece goes out when the others have had their time.
        assert!(begun.elapsed() >= Duration::from_secs_f64(0.3 - 2.0 * PIECE as f64 / 1e6), "{:?}", begun.elapsed());
    }

    #[tokio::test]
    async fn what_moves_does_not_rest() {
        let motion = Motion::begin();
        let mover = motion.clone();
        let moving = async move {
            for _ in 0..10 {
                tokio::time::sleep(Duration::from_millis(20)).await;
                mover.moved();
            }
        };
        let begun = Instant::now();
        tokio::join!(moving, motion.rests(Duration::from_millis(100)));
        assert!(begun.elapsed() >= Duration::from_millis(290), "{:?}", begun.elapsed());
    }
}
