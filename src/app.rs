//! What handlers and workers share.

use crate::clock::Clock;
use crate::config::Settings;
use crate::http::arrivals::Arrivals;
use crate::http::receipts::Verifications;
use crate::store::{Id, Store};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use tokio::sync::{Notify, Semaphore};
use tokio_util::sync::CancellationToken;

/// What handlers and workers share. Cheap to clone.
#[derive(Clone)]
pub struct App {
    /// What lasts.
    pub store: Store,
    /// The time.
    pub clock: Arc<dyn Clock>,
    /// Settings.
    pub settings: Arc<Settings>,
    /// Where links to this service begin, such as `http://127.0.0.1:8080`.
    pub base_url: Arc<str>,
    /// Told when a job on a complete acquisition was queued, or a job's acquisition completed.
    pub jobs_wake: Arc<Notify>,
    /// Told when a job on an open acquisition was queued.
    pub live_jobs_wake: Arc<Notify>,
    /// Told when an event was queued for a receiver.
    pub outbox_wake: Arc<Notify>,
    /// Permits to decode and render.
    pub cpu: Arc<Semaphore>,
    /// Permits to receive a frame.
    pub uploads: Arc<Semaphore>,
    /// Frames that are arriving now.
    pub arrivals: Arrivals,
    /// Bytes on their way in that the disk does not know of yet.
    pub promised_bytes: Arc<AtomicU64>,
    /// Verifications that run for receipts.
    pub verifications: Verifications,
    /// Cancelled when the process goes down.
    pub shutdown: CancellationToken,
}

impl App {
    /// An app on an open store.
    pub fn new(store: Store, clock: Arc<dyn Clock>, settings: Settings, base_url: &str) -> Self {
        Self {
            store,
            clock,
            cpu: Arc::new(Semaphore::new(settings.limits.cpu)),
            uploads: Arc::new(Semaphore::new(settings.limits.uploads)),
            settings: Arc::new(settings),
            base_url: base_url.trim_end_matches('/').into(),
            jobs_wake: Arc::default(),
            live_jobs_wake: Arc::default(),
            outbox_wake: Arc::default(),
            arrivals: Arrivals::default(),
            promised_bytes: Arc::default(),
            verifications: Verifications::default(),
            shutdown: CancellationToken::new(),
        }
    }

    /// The time, ms since 1970.
    pub fn now_ms(&self) -> i64 {
        self.clock.now_ms()
    }

    /// A new id.
    pub fn new_id(&self) -> Id {
        Id(self.clock.new_id())
    }
}
