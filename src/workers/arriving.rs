//! The frames of an acquisition that is still open, or their previews: a job on it waits for every one until it was acknowledged.

use super::watch::Watch;
use crate::app::App;
use crate::pipeline::source::Frame;
use crate::pipeline::{FrameFiles, FrameSource, Progress, SourceError, preview};
use crate::store::acquisitions::Acquisition;
use crate::store::jobs::Job;
use crate::store::leases::WaitingFor;
use crate::store::{Id, StoreError};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::sync::watch::Receiver;

/// Longest time between two looks for a frame: those that another process takes are not heard here. Also how soon a waiting job
/// sees that it shall stop.
const LOOK: Duration = Duration::from_millis(400);
/// Shortest time between two looks, however many frames of other acquisitions arrive.
const REST: Duration = Duration::from_millis(20);
/// Frames that are taken up with one look.
const AT_ONCE: u32 = 256;
const MS_PER_HOUR: f64 = 3_600_000.0;

/// What is awaited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Awaited {
    Frames,
    Previews,
}

/// Frames that are there, and those that will be. Waits on the thread that computes; never on an async one.
pub(super) struct ArrivingFrames {
    app: App,
    acquisition: Id,
    awaited: Awaited,
    watch: Arc<Watch>,
    runtime: Handle,
    files: RwLock<FrameFiles>,
    arrivals: Mutex<Receiver<()>>,
    life: Mutex<Life>,
}

/// Signs that somebody still sends.
struct Life {
    frames: i64,
    seen_ms: i64,
}

impl ArrivingFrames {
    /// The frames of an acquisition, for a job that waits for those that are not there.
    pub async fn new(app: &App, acquisition: &Acquisition, job: &Job, watch: &Arc<Watch>) -> Result<Self, StoreError> {
        let last_ms = app.store.last_arrival_ms(acquisition.row.id).await?;
        Ok(Self::of(app, acquisition, Awaited::Frames, acquisition.row.sensor_px, last_ms, job, watch))
    }

    /// The previews of an acquisition, for the job that looks at them.
    pub async fn previews(
        app: &App,
        acquisition: &Acquisition,
        job: &Job,
        watch: &Arc<Watch>,
    ) -> Result<Self, StoreError> {
        let last_ms = app.store.last_preview_ms(acquisition.row.id).await?;
        let columns = preview::columns_of(acquisition.row.sensor_px);
        Ok(Self::of(app, acquisition, Awaited::Previews, columns, last_ms, job, watch))
    }

    fn of(
        app: &App,
        acquisition: &Acquisition,
        awaited: Awaited,
        columns: u32,
        last_ms: Option<i64>,
        job: &Job,
        watch: &Arc<Watch>,
    ) -> Self {
        let seen_ms = last_ms.unwrap_or(job.created_at_ms).max(job.created_at_ms);
        Self {
            app: app.clone(),
            acquisition: acquisition.row.id,
            awaited,
            watch: watch.clone(),
            runtime: Handle::current(),
            files: RwLock::new(FrameFiles::new(columns, vec![Vec::new(); acquisition.views.len()])),
            arrivals: Mutex::new(app.store.arrivals()),
            life: Mutex::new(Life { frames: -1, seen_ms }),
        }
    }

    fn files(&self) -> std::sync::RwLockReadGuard<'_, FrameFiles> {
        self.files.read().unwrap_or_else(PoisonError::into_inner) // a list that only grows
    }

    /// Takes up what has arrived of a view. True when no more can come.
    async fn look(&self, view: usize) -> Result<bool, StoreError> {
        let from = self.files().frames(view) as u32;
        let (whole, arrived, new) = match self.awaited {
            Awaited::Frames => self.new_frames(view as u32, from).await?,
            Awaited::Previews => self.new_previews(view as u32, from).await?,
        };
        let mut files = self.files.write().unwrap_or_else(PoisonError::into_inner);
        for path in new {
            files.push(view, path);
        }
        let mut life = self.life.lock().unwrap_or_else(PoisonError::into_inner);
        if life.frames >= 0 && arrived != life.frames {
            life.seen_ms = self.app.now_ms();
        }
        life.frames = arrived;
        Ok(whole)
    }

    /// Whether these are the last frames of the view, how many of all views are there, and where the new ones lie.
    async fn new_frames(&self, view: u32, from: u32) -> Result<(bool, i64, Vec<PathBuf>), StoreError> {
        let (store, id) = (&self.app.store, self.acquisition);
        // The state first: what a complete acquisition lacks never comes.
        let (complete, arrived) = store.arrived(id).await?;
        let new = store.frames_from(id, view, from, AT_ONCE, complete).await?;
        let whole = complete && new.len() < AT_ONCE as usize;
        let paths = new.into_iter().map(|f| store.folder().frame(id, f.view, f.frame, &f.sha256)).collect();
        Ok((whole, arrived, paths))
    }

    /// The same of previews, which end where frames will.
    async fn new_previews(&self, view: u32, from: u32) -> Result<(bool, i64, Vec<PathBuf>), StoreError> {
        let (store, id) = (&self.app.store, self.acquisition);
        let (expected, arrived) = store.previews_arrived(id, view).await?;
        let new = store.previews_from(id, view, from, AT_ONCE).await?;
        let whole = expected.is_some_and(|expected| from + new.len() as u32 >= expected);
        let paths = new.into_iter().map(|p| store.folder().preview(id, p.view, p.frame, &p.sha256)).collect();
        Ok((whole, arrived, paths))
    }

    fn quiet_ms(&self) -> i64 {
        self.app.now_ms() - self.life.lock().unwrap_or_else(PoisonError::into_inner).seen_ms
    }

    /// Sleeps until something arrived, or for [`LOOK`].
    fn sleep(&self) {
        let mut arrivals = self.arrivals.lock().unwrap_or_else(PoisonError::into_inner);
        self.runtime.block_on(async {
            tokio::time::sleep(REST).await;
            let _ = tokio::time::timeout(LOOK, arrivals.changed()).await;
        });
    }
}

impl FrameSource for ArrivingFrames {
    fn views(&self) -> usize {
        self.files().views()
    }

    fn frames(&self, view: usize) -> usize {
        self.files().frames(view)
    }

    fn wait_for(&self, view: usize, frame: usize) -> Result<bool, SourceError> {
        let since_ms = self.app.now_ms();
        loop {
            if frame < self.frames(view) {
                self.watch.waits_for(None);
                return Ok(true);
            }
            if self.watch.cancelled() {
                return Err(SourceError::Stopped);
            }
            match self.runtime.block_on(self.look(view)) {
                Ok(_) if frame < self.frames(view) => continue,
                Ok(true) => {
                    self.watch.waits_for(None);
                    return Ok(false);
                }
                Ok(false) => {}
                // It passes, or patience ends.
                Err(error) => tracing::warn!(acquisition = %self.acquisition, %error, "cannot look for frames"),
            }
            let quiet_ms = self.quiet_ms();
            if u128::try_from(quiet_ms).is_ok_and(|quiet| quiet > self.app.settings.live.patience.as_millis()) {
                return Err(SourceError::Abandoned { view, frame, quiet_h: quiet_ms as f64 / MS_PER_HOUR });
            }
            self.watch.waits_for(Some(WaitingFor { view: view as u32, frame: frame as u32, since_ms }));
            self.sleep();
        }
    }

    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
        self.files().lines(view, frame)
    }

    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
        self.files().load(view, frame)
    }
}
