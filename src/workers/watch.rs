//! Keeps a running job's lease alive, records its progress and what it finds, and brings it the wish to stop.

use crate::app::App;
use crate::pipeline::{Found, Progress, ProgressReport};
use crate::store::Id;
use crate::store::jobs::Job;
use crate::store::leases::{Heartbeat, Lease, Reached, WaitingFor};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Instant;
use tokio::runtime::Handle;

/// Why a job shall stop. Later ones in this list outweigh earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Stop {
    /// It shall not.
    No,
    /// The process goes down.
    Shutdown,
    /// Somebody cancelled it.
    Cancelled,
    /// The lease is lost: somebody else has the job, or it ended.
    LeaseLost,
}

impl Stop {
    fn of(code: u8) -> Self {
        match code {
            1 => Self::Shutdown,
            2 => Self::Cancelled,
            3 => Self::LeaseLost,
            _ => Self::No,
        }
    }
}

/// Sits between a job and the store.
pub struct Watch {
    app: App,
    job: Id,
    token: i64,
    runtime: Handle,
    stop: AtomicU8,
    last: Mutex<Option<Stage>>,
    waiting_for: Mutex<Option<WaitingFor>>,
    /// What was found and is not recorded yet: nothing, unless the store refused.
    found: Mutex<Vec<Found>>,
}

#[derive(Debug, Clone, Copy)]
struct Stage {
    report: ProgressReport,
    began: Instant,
    began_at_m: f64,
}

/// What a lock holds is written in one step: whole, whoever panicked.
fn whole<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch {
    /// Over a job that has just been claimed. Must be called on an async thread.
    pub fn new(app: &App, job: &Job) -> Arc<Self> {
        Arc::new(Self {
            app: app.clone(),
            job: job.id,
            token: job.lease_token,
            runtime: Handle::current(),
            stop: AtomicU8::new(0),
            last: Mutex::new(None),
            waiting_for: Mutex::new(None),
            found: Mutex::new(Vec::new()),
        })
    }

    /// Asks the job to stop.
    pub fn stop(&self, why: Stop) {
        self.stop.fetch_max(why as u8, Ordering::SeqCst);
    }

    /// Why the job shall stop, if it shall.
    pub fn stopped(&self) -> Stop {
        Stop::of(self.stop.load(Ordering::SeqCst))
    }

    /// Says which frame the job waits for, if it does.
    pub fn waits_for(&self, frame: Option<WaitingFor>) {
        *whole(&self.waiting_for) = frame;
    }

    fn heartbeat(&self) -> Heartbeat {
        Heartbeat { reached: self.reached(), waiting_for: *whole(&self.waiting_for) }
    }

    fn reached(&self) -> Option<Reached> {
        let stage = (*whole(&self.last))?;
        let seconds = stage.began.elapsed().as_secs_f64();
        let done_m = stage.report.done_m - stage.began_at_m;
        let finite = |m: f64| if m.is_finite() { m } else { 0.0 };
        Some(Reached {
            stage: stage.report.stage,
            done_m: finite(stage.report.done_m),
            total_m: finite(stage.report.total_m),
            metres_per_second: (seconds > 0.1 && done_m > 0.0).then_some(done_m / seconds),
        })
    }

    /// Starts the heart of a job: a thread of its own, so that neither vision nor requests can keep it from beating. It stops
    /// when the returned end of the channel is dropped.
    pub fn beat(self: &Arc<Self>) -> std::io::Result<mpsc::Sender<()>> {
        let (alive, ended) = mpsc::channel();
        let watch = self.clone();
        std::thread::Builder::new().name("heartbeat".into()).spawn(move || {
            let (app, job, token) = (&watch.app, watch.job, watch.token);
            let lease = app.settings.lease;
            while let Err(mpsc::RecvTimeoutError::Timeout) = ended.recv_timeout(lease.heartbeat) {
                let until_ms = app.now_ms() + lease.duration.as_millis() as i64;
                match watch.runtime.block_on(app.store.heartbeat(job, token, &watch.heartbeat(), until_ms)) {
                    Ok(Lease::Held) => {}
                    Ok(Lease::CancelRequested) => watch.stop(Stop::Cancelled),
                    Ok(Lease::Lost) => {
                        watch.stop(Stop::LeaseLost);
                        break;
                    }
                    Err(error) => tracing::warn!(%job, %error, "a heartbeat was missed"),
                }
            }
        })?;
        Ok(alive)
    }
}

impl Progress for Watch {
    fn report(&self, report: ProgressReport) {
        let mut last = whole(&self.last);
        match last.as_mut() {
            Some(stage) if stage.report.stage == report.stage => stage.report = report,
            _ => *last = Some(Stage { report, began: Instant::now(), began_at_m: report.done_m }),
        }
    }

    /// Recorded at once: somebody may be looking on. What the store cannot take now goes with the next stretch.
    fn found(&self, found: Found) {
        let mut all = whole(&self.found);
        all.push(found);
        let kept = self.app.store.keep_provisional(self.job, self.token, &all);
        match self.runtime.block_on(kept) {
            Ok(Lease::Lost) => self.stop(Stop::LeaseLost),
            Ok(_) => all.clear(),
            Err(error) => tracing::warn!(job = %self.job, %error, "provisional results were not recorded"),
        }
    }

    fn cancelled(&self) -> bool {
        self.stopped() != Stop::No
    }
}
