//! Which frames are arriving now. A client knows before the service does that its link is dead: when it sends the frame again,
//! the request that hangs is ended, and its place is free.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

/// A request that was silent for this long is stale when the same frame comes again.
const STALE: Duration = Duration::from_secs(1);

/// Acquisition, view and number.
pub type FramePlace = (Uuid, u32, u32);

struct Arriving {
    request: u64,
    last_byte: Instant,
    end: CancellationToken,
}

#[derive(Default)]
struct Table {
    next_request: u64,
    arriving: HashMap<FramePlace, Vec<Arriving>>,
}

/// All frames that are arriving. Cheap to clone.
#[derive(Clone, Default)]
pub struct Arrivals(Arc<Mutex<Table>>);

/// One request that receives a frame; forgotten when it is dropped.
pub struct Arrival {
    arrivals: Arrivals,
    place: FramePlace,
    request: u64,
    end: CancellationToken,
}

impl Arrivals {
    /// Begins to receive a frame. Requests for the same one that have been silent for a while are ended.
    pub fn begin(&self, place: FramePlace) -> Arrival {
        let mut table = self.table();
        let request = table.next_request;
        table.next_request += 1;
        let end = CancellationToken::new();
        let same = table.arriving.entry(place).or_default();
        for stale in same.iter().filter(|a| a.last_byte.elapsed() >= STALE) {
            stale.end.cancel();
        }
        same.push(Arriving { request, last_byte: Instant::now(), end: end.clone() });
        Arrival { arrivals: self.clone(), place, request, end }
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner) // nothing in it can be half done
    }
}

impl Arrival {
    /// Bytes came.
    pub fn lives(&self) {
        if let Some(same) = self.arrivals.table().arriving.get_mut(&self.place)
            && let Some(own) = same.iter_mut().find(|a| a.request == self.request)
        {
            own.last_byte = Instant::now();
        }
    }

    /// Waits until another request takes over.
    pub async fn ended(&self) {
        self.end.cancelled().await;
    }
}

impl Drop for Arrival {
    fn drop(&mut self) {
        let mut table = self.arrivals.table();
        if let Some(same) = table.arriving.get_mut(&self.place) {
            same.retain(|a| a.request != self.request);
            if same.is_empty() {
                table.arriving.remove(&self.place);
            }
        }
    }
}
