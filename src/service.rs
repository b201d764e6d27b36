//! Starts and stops everything that one process runs: workers, deliveries, HTTP. `serve`, `worker`, `demo` and the tests use it.

use crate::app::App;
use crate::clock::{Clock, SystemClock};
use crate::config::Settings;
use crate::http;
use crate::store::folder::Instance;
use crate::store::{Store, StoreError};
use crate::ticketing::{self, Dispatcher};
use crate::workers::{Engine, Pipeline, Workers};
use rand::SeedableRng;
use std::fs::File;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio_util::task::TaskTracker;

/// Time that a running job has to notice that the process goes down; it is asked once a frame.
const HAND_BACK: Duration = Duration::from_secs(30);

/// Why a process could not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The address.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The cause.
        source: std::io::Error,
    },
}

/// A running process.
pub struct Service {
    /// What its parts share.
    pub app: App,
    /// Where it listens; `None` for a process of workers only.
    pub address: Option<SocketAddr>,
    tasks: TaskTracker,
    instance: Instance,
    _service_lock: Option<File>,
}

impl Service {
    /// Starts the service: HTTP, and workers in the same process if the settings say so.
    pub async fn start(settings: Settings) -> Result<Self, StartError> {
        Self::start_with(settings, Arc::new(SystemClock), Arc::new(Pipeline)).await
    }

    /// Like [`Self::start`], with clock and engine of the caller's choice.
    pub async fn start_with(
        settings: Settings,
        clock: Arc<dyn Clock>,
        engine: Arc<dyn Engine>,
    ) -> Result<Self, StartError> {
        let store = Store::open(&settings.data).await?;
        let lock = store.folder().lock_for_service()?;
        let failed = |source| StartError::Listen { address: settings.listen, source };
        let listener = TcpListener::bind(settings.listen).await.map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let base_url = settings.public_url.clone().unwrap_or_else(|| format!("http://{address}"));
        let limits = settings.limits;
        let app = App::new(store, clock, settings, &base_url);
        let service = Self::begin(app, engine, Some(address), Some(lock)).await?;
        let router = http::router::router(&service.app);
        service.tasks.spawn(http::server::serve(listener, router, limits, service.app.shutdown.clone()));
        Ok(service)
    }

    /// Starts workers only, beside the service of the same data folder.
    pub async fn start_workers(settings: Settings) -> Result<Self, StartError> {
        let store = Store::open(&settings.data).await?;
        let app = App::new(store, Arc::new(SystemClock), settings, "");
        Self::begin(app, Arc::new(Pipeline), None, None).await
    }

    async fn begin(
        app: App,
        engine: Arc<dyn Engine>,
        address: Option<SocketAddr>,
        lock: Option<File>,
    ) -> Result<Self, StartError> {
        let instance = app.store.folder().register(app.clock.new_id())?;
        let alone = app.store.folder().others(&instance)? == 0;
        if lock.is_some() {
            let swept = app.store.sweep(alone).await?;
            if swept > 0 {
                tracing::info!(files = swept, "removed what an earlier process left unfinished");
            }
        }
        let tasks = TaskTracker::new();
        Workers::new(app.clone(), &instance.id.to_string(), engine).spawn(&tasks);
        if lock.is_some() {
            let settings = ticketing::Settings::new(&app.base_url);
            let rng = rand_chacha::ChaCha8Rng::from_rng(&mut rand::rng());
            let dispatcher = Dispatcher::new(app.store.clone(), Arc::clone(&app.clock), settings, rng);
            tasks.spawn(http::unpack::resume(app.clone()));
            tasks.spawn(http::tus::tidy(app.clone()));
            tasks.spawn(dispatcher.run(Arc::clone(&app.outbox_wake), app.shutdown.clone()));
        }
        Ok(Self { app, address, tasks, instance, _service_lock: lock })
    }

    /// Where clients reach it from this machine.
    pub fn base_url(&self) -> String {
        self.address.map_or_else(String::new, |address| format!("http://{address}"))
    }

    /// Goes down in order: no new requests, open ones end, running jobs are handed back, the database is closed.
    pub async fn stop(self) {
        self.app.shutdown.cancel();
        self.tasks.close();
        if tokio::time::timeout(HAND_BACK, self.tasks.wait()).await.is_err() {
            tracing::warn!("a job did not stop in time; its lease will run out");
        }
        self.app.store.close().await;
        drop(self.instance);
    }
}

/// Waits for SIGTERM or SIGINT.
pub async fn signal() {
    let interrupt = tokio::signal::ctrl_c();
    #[cfg(unix)]
    {
        let Ok(mut terminate) = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate()) else {
            let _ = interrupt.await;
            return;
        };
        tokio::select! {
            _ = interrupt => {}
            _ = terminate.recv() => {}
        }
    }
    #[cfg(not(unix))]
    {
        let _ = interrupt.await;
    }
}
