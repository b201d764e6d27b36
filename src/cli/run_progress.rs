//! How `train` and `inspect` show where they stand (a bar on a terminal, plain lines elsewhere, JSON lines for scripts, always on
//! stderr), and how Ctrl-C reaches them.

use super::time_left::time_left;
use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use ropescope::pipeline::{Progress, ProgressReport};
use ropescope::service;
use serde_json::json;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Shortest time between two lines.
const LINE_EVERY: Duration = Duration::from_secs(1);
/// Share of a stage between two plain lines ...
const LINE_EVERY_SHARE: f64 = 0.1;
/// ... unless that takes longer than this.
const LINE_AFTER: Duration = Duration::from_secs(30);
/// Exit code of a run that a second Ctrl-C ended at once, as shells have it.
pub(crate) const INTERRUPTED: u8 = 130;

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Bar,
    Lines,
    Json,
}

/// Shows the progress of a run of the pipeline, and stops it on Ctrl-C.
pub(crate) struct Watcher {
    form: Form,
    stages: &'static [&'static str],
    bar: ProgressBar,
    state: Mutex<State>,
    interrupted: Arc<AtomicBool>,
    said_so: AtomicBool,
}

struct State {
    stage: &'static str,
    stage_began: Instant,
    latest: Instant,
    last_line: Option<(Instant, f64)>,
}

impl Watcher {
    /// Watches a run that goes through `stages`, each once over the same metres; listens to Ctrl-C from now on.
    pub(crate) fn start(json: bool, stages: &'static [&'static str]) -> anyhow::Result<Self> {
        let form = match (json, std::io::stderr().is_terminal()) {
            (true, _) => Form::Json,
            (false, true) => Form::Bar,
            (false, false) => Form::Lines,
        };
        let bar = if form == Form::Bar { ProgressBar::new(1000) } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {percent:>3} %  {msg}") {
            bar.set_style(style);
        }
        bar.set_message(format!("{} begins", stages.first().copied().unwrap_or("work")));
        let now = Instant::now();
        let state =
            State { stage: stages.first().copied().unwrap_or(""), stage_began: now, latest: now, last_line: None };
        Ok(Self {
            form,
            stages,
            bar,
            state: Mutex::new(state),
            interrupted: listen()?,
            said_so: AtomicBool::new(false),
        })
    }

    /// Takes the bar away; results follow.
    pub(crate) fn done(&self) {
        self.bar.finish_and_clear();
    }

    /// Shows that `done` of `of` pieces are done, in a stage that is not measured in metres.
    pub(crate) fn count(&self, stage: &'static str, done: usize, of: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if state.stage != stage {
            (state.stage, state.stage_began, state.last_line) = (stage, now, None);
        }
        let share = done as f64 / of.max(1) as f64;
        if !self.due(&state, now, share) {
            return;
        }
        state.last_line = Some((now, share));
        let left_s = (now - state.stage_began).as_secs_f64() * (of - done) as f64 / done.max(1) as f64;
        match self.form {
            Form::Json => {
                say(&json!({"event": "progress", "stage": stage, "done": done, "of": of, "seconds_left": left_s})
                    .to_string());
            }
            Form::Bar => {
                self.bar.set_position((1000.0 * share) as u64);
                self.bar.set_message(format!("{stage} {done} of {of}"));
            }
            Form::Lines => say(&format!("{stage} {done} of {of}")),
        }
    }

    /// Says something that does not end the run.
    pub(crate) fn remark(&self, sentence: &str) {
        if self.form == Form::Json {
            say(&json!({"event": "remark", "detail": sentence}).to_string());
        } else {
            self.bar.suspend(|| say(sentence));
        }
    }

    /// Whether it is time to show how far a stage is.
    fn due(&self, state: &State, now: Instant, share: f64) -> bool {
        match (self.form, state.last_line) {
            (Form::Bar, _) => true,
            (_, None) => now - state.stage_began >= LINE_EVERY,
            (Form::Json, Some((at, _))) => now - at >= LINE_EVERY,
            (Form::Lines, Some((at, before))) => {
                now - at >= LINE_EVERY && (share - before >= LINE_EVERY_SHARE || now - at >= LINE_AFTER)
            }
        }
    }

    fn show(&self, report: ProgressReport, speed: f64, left_s: f64) {
        let ProgressReport { stage, done_m, total_m } = report;
        if self.form == Form::Json {
            say(&json!({"event": "progress", "stage": stage, "done_m": done_m, "total_m": total_m,
                       "metres_per_second": speed, "seconds_left": left_s})
            .to_string());
            return;
        }
        let left = Some(time_left(left_s)).filter(|words| !words.is_empty()).map(|words| format!(", {words}"));
        let sentence = format!("{stage} {done_m:.1} of {total_m:.1} m, {speed:.2} m/s{}", left.unwrap_or_default());
        if self.form == Form::Bar {
            self.bar.set_position((1000.0 * done_m / total_m.max(1e-9)) as u64);
            self.bar.set_message(sentence);
        } else {
            say(&sentence);
        }
    }
}

impl Progress for Watcher {
    fn report(&self, report: ProgressReport) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner); // a report more or less
        let now = Instant::now();
        if state.stage != report.stage {
            (state.stage, state.stage_began, state.last_line) = (report.stage, state.latest, None);
        }
        state.latest = now;
        let share = report.done_m / report.total_m.max(1e-9);
        if self.due(&state, now, share) {
            state.last_line = Some((now, share));
            let speed = report.done_m / (now - state.stage_began).as_secs_f64().max(1e-3);
            let stages_left = self.stages.iter().rev().position(|s| *s == report.stage).unwrap_or(0) as f64;
            let left_m = report.total_m - report.done_m + stages_left * report.total_m;
            self.show(report, speed, left_m / speed.max(1e-9));
        }
    }

    fn cancelled(&self) -> bool {
        let stop = self.interrupted.load(Ordering::Relaxed);
        if stop && !self.said_so.swap(true, Ordering::Relaxed) && self.form != Form::Json {
            self.bar.suspend(|| say("stopping"));
        }
        stop
    }
}

/// A line on stderr. Nobody reading any more is no reason to stop.
pub(crate) fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Becomes true with the first Ctrl-C (or SIGTERM); the second ends the process at once.
fn listen() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&flag);
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot listen to Ctrl-C")?;
    std::thread::Builder::new()
        .name("interrupt".into())
        .spawn(move || {
            runtime.block_on(async {
                service::signal().await;
                set.store(true, Ordering::Relaxed);
                service::signal().await;
                std::process::exit(INTERRUPTED.into());
            });
        })
        .context("cannot listen to Ctrl-C")?;
    Ok(flag)
}
