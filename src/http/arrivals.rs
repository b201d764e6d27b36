//! Which frames are arriving now. A client knows before the service does that its link is dead: when it sends the frame again,
//! the request that hangs is ended, and its place is free.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;
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

#[derive(Default)]
struct Shared {
    table: Mutex<Table>,
    gone: Notify,
}

/// All frames (and archives, under view 0 and frame 0) that are arriving. Cheap to clone.
#[derive(Clone, Default)]
pub struct Arrivals(Arc<Shared>);

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
        for stale in table.at(place).iter().filter(|a| a.last_byte.elapsed() >= STALE) {
            stale.end.cancel();
        }
        table.enter(self, place)
    }

    /// Ends every request at this place, stale or not, waits until they have let go, and takes it.
    pub async fn take_over(&self, place: FramePlace) -> Arrival {
        loop {
            let gone = self.0.gone.notified(); // before looking, or one that goes in between is missed
            {
                let mut table = self.table();
                if table.at(place).is_empty() {
                    return table.enter(self, place);
                }
                table.at(place).iter().for_each(|other| other.end.cancel());
            }
            gone.await;
        }
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.0.table.lock().unwrap_or_else(PoisonError::into_inner) // nothing in it can be half done
    }
}

impl Table {
    fn at(&mut self, place: FramePlace) -> &mut Vec<Arriving> {
        self.arriving.entry(place).or_default()
    }

    fn enter(&mut self, arrivals: &Arrivals, place: FramePlace) -> Arrival {
        let request = self.next_request;
        self.next_request += 1;
        let end = CancellationToken::new();
        self.at(place).push(Arriving { request, last_byte: Instant::now(), end: end.clone() });
        Arrival { arrivals: arrivals.clone(), place, request, end }
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
        drop(table);
        self.arrivals.0.gone.notify_waiters();
    }
}
