//! How an upload shows where it stands: a bar on a terminal, plain lines elsewhere, JSON for scripts.

use super::time_left::time_left;
use indicatif::{ProgressBar, ProgressStyle};
use ropescope::upload::{Plan, Report, Tick};
use serde_json::json;
use std::io::IsTerminal;
use std::sync::Mutex;

/// Shortest time between two plain lines, in s.
const LINE_EVERY_S: f64 = 5.0;

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// A bar on stderr.
    Bar,
    /// Lines on stderr.
    Lines,
    /// JSON objects on stdout.
    Json,
}

impl Form {
    /// JSON when asked for, a bar when a person watches.
    pub(crate) fn choose(json: bool) -> Self {
        match (json, std::io::stderr().is_terminal()) {
            (true, _) => Self::Json,
            (false, true) => Self::Bar,
            (false, false) => Self::Lines,
        }
    }
}

/// Shows the progress of one upload.
pub(crate) struct Watcher {
    form: Form,
    bar: ProgressBar,
    last_line_s: Mutex<Option<f64>>,
}

impl Watcher {
    /// Nothing is shown before the first tick.
    pub(crate) fn new(form: Form) -> Self {
        let bar = if form == Form::Bar { ProgressBar::no_length() } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {percent:>3} %  {msg}") {
            bar.set_style(style);
        }
        Self { form, bar, last_line_s: Mutex::new(None) }
    }

    /// Takes the state after a frame.
    pub(crate) fn tick(&self, tick: Tick) {
        match self.form {
            Form::Json => println!(
                "{}",
                json!({"event": "progress", "frames": tick.frames, "held": tick.held, "bytes": tick.bytes,
                       "sent_bytes": tick.sent_bytes, "mb_per_second": tick.mb_per_second(), "seconds_left": tick.seconds_left()})
            ),
            Form::Bar => {
                self.bar.set_length(tick.bytes.max(1));
                self.bar.set_position(tick.sent_bytes);
                self.bar.set_message(sentence(tick));
            }
            Form::Lines => {
                let Ok(mut last_s) = self.last_line_s.lock() else { return };
                let due = last_s.is_none_or(|last| tick.seconds - last >= LINE_EVERY_S) || tick.held == tick.frames;
                if due {
                    *last_s = Some(tick.seconds);
                    eprintln!("{}", sentence(tick));
                }
            }
        }
    }

    /// Says what came of it.
    pub(crate) fn done(&self, plan: &Plan, report: &Report) {
        self.bar.finish_and_clear();
        if self.form == Form::Json {
            let mut line = json!(report);
            line["event"] = json!("done");
            println!("{line}");
            return;
        }
        let mb = report.sent_bytes as f64 / 1e6;
        println!(
            "{} of {}: {} frames complete, {} sent now ({mb:.1} MB in {:.1} s)",
            plan.rope, plan.ropeway, report.frames, report.sent_frames, report.seconds
        );
        println!(
            "ropeway     {}\nrope        {}\nacquisition {}",
            report.ropeway_id, report.rope_id, report.acquisition_id
        );
    }
}

fn sentence(tick: Tick) -> String {
    let left = tick.seconds_left().map(time_left).filter(|words| !words.is_empty());
    let left = left.map_or_else(String::new, |words| format!(", {words}"));
    format!("{}/{} frames, {:.1} MB/s{left}", tick.held, tick.frames, tick.mb_per_second())
}
