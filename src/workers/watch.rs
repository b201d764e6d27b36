//! Keeps a running job's lease alive, records its progress and brings it the wish to stop.

use crate::app::App;
use crate::pipeline::{Progress, ProgressReport};
use crate::store::jobs::Job;
use crate::store::leases::{Heartbeat, Lease};
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
#[derive(Debug)]
pub struct Watch {
    stop: AtomicU8,
    last: Mutex<Option<Stage>>,
}

#[derive(Debug, Clone, Copy)]
struct Stage {
    report: ProgressReport,
    began: Instant,
    began_at_m: f64,
}

impl Watch {
    /// Over a job that has just been claimed.
    pub fn new() -> Arc<Self> {
        Arc::new(Self { stop: AtomicU8::new(0), last: Mutex::new(None) })
    }

    /// Asks the job to stop.
    pub fn stop(&self, why: Stop) {
        self.stop.fetch_max(why as u8, Ordering::SeqCst);
    }

    /// Why the job shall stop, if it shall.
    pub fn stopped(&self) -> Stop {
        Stop::of(self.stop.load(Ordering::SeqCst))
    }

    fn last(&self) -> MutexGuard<'_, Option<Stage>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner) // a report is whole or absent
    }

    fn heartbeat(&self) -> Option<Heartbeat> {
        let stage = (*self.last())?;
        let seconds = stage.began.elapsed().as_secs_f64();
        let done_m = stage.report.done_m - stage.began_at_m;
        let finite = |m: f64| if m.is_finite() { m } else { 0.0 };
        Some(Heartbeat {
            stage: stage.report.stage,
            done_m: finite(stage.report.done_m),
            total_m: finite(stage.report.total_m),
            metres_per_second: (seconds > 0.1 && done_m > 0.0).then_some(done_m / seconds),
        })
    }

    /// Starts the heart of a job: a thread of its own, so that neither vision nor requests can keep it from beating. It stops
    /// when the returned end of the channel is dropped.
    pub fn beat(self: &Arc<Self>, app: &App, job: &Job) -> std::io::Result<mpsc::Sender<()>> {
        let (alive, ended) = mpsc::channel();
        let (watch, app, id, token) = (self.clone(), app.clone(), job.id, job.lease_token);
        let runtime = Handle::current();
        std::thread::Builder::new().name("heartbeat".into()).spawn(move || {
            let lease = app.settings.lease;
            while let Err(mpsc::RecvTimeoutError::Timeout) = ended.recv_timeout(lease.heartbeat) {
                let until_ms = app.now_ms() + lease.duration.as_millis() as i64;
                match runtime.block_on(app.store.heartbeat(id, token, watch.heartbeat(), until_ms)) {
                    Ok(Lease::Held) => {}
                    Ok(Lease::CancelRequested) => watch.stop(Stop::Cancelled),
                    Ok(Lease::Lost) => {
                        watch.stop(Stop::LeaseLost);
                        break;
                    }
                    Err(error) => tracing::warn!(job = %id, %error, "a heartbeat was missed"),
                }
            }
        })?;
        Ok(alive)
    }
}

impl Progress for Watch {
    fn report(&self, report: ProgressReport) {
        let mut last = self.last();
        match last.as_mut() {
            Some(stage) if stage.report.stage == report.stage => stage.report = report,
            _ => *last = Some(Stage { report, began: Instant::now(), began_at_m: report.done_m }),
        }
    }

    fn cancelled(&self) -> bool {
        self.stopped() != Stop::No
    }
}
