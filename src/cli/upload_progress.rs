//! How an upload shows where it stands: a bar on a terminal, plain lines elsewhere, JSON for scripts.

use super::time_left::time_left;
use indicatif::{ProgressBar, ProgressStyle};
use ropescope::upload::{Report, Stage, Tick};
use serde_json::json;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Shortest time between two plain lines, in s.
const LINE_EVERY_S: f64 = 5.0;

/// Shortest time between two lines that tell a person why nothing moves; scripts hear everything.
const WAIT_EVERY: Duration = Duration::from_secs(10);

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
    last_line_s: Mutex<Option<(f64, Stage)>>,
    last_wait: Mutex<Option<Instant>>,
}

impl Watcher {
    /// Nothing is shown before the first tick.
    pub(crate) fn new(form: Form) -> Self {
        let bar = if form == Form::Bar { ProgressBar::no_length() } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {percent:>3} %  {msg}") {
            bar.set_style(style);
        }
        Self { form, bar, last_line_s: Mutex::new(None), last_wait: Mutex::new(None) }
    }

    /// Takes the state after a frame.
    pub(crate) fn tick(&self, tick: &Tick) {
        match self.form {
            Form::Json => {
                let mut line = json!(tick);
                line["event"] = json!("progress");
                line["seconds_left"] = json!(tick.seconds_left());
                println!("{line}");
            }
            Form::Bar => {
                self.bar.set_length(tick.bytes.max(1));
                self.bar.set_position(tick.sent_bytes);
                self.bar.set_message(sentence(tick));
            }
            Form::Lines => {
                let Ok(mut last_s) = self.last_line_s.lock() else { return };
                let due = last_s.is_none_or(|(last_s, stage)| {
                    tick.seconds - last_s >= LINE_EVERY_S || stage != tick.stage && tick.stage != Stage::Announcing
                });
                if due {
                    *last_s = Some((tick.seconds, tick.stage));
                    eprintln!("{}", sentence(tick));
                }
            }
        }
    }

    /// Says why nothing moves.
    pub(crate) fn waiting(&self, last: &str, wait: Duration) {
        let Ok(mut last_wait) = self.last_wait.lock() else { return };
        if self.form != Form::Json && last_wait.is_some_and(|when| when.elapsed() < WAIT_EVERY) {
            return;
        }
        *last_wait = Some(Instant::now());
        let wait_s = wait.as_secs_f64();
        match self.form {
            Form::Json => println!("{}", json!({"event": "waiting", "reason": last, "wait_s": wait_s})),
            Form::Bar => self.bar.println(format!("{last}; trying again in {wait_s:.0} s")),
            Form::Lines => eprintln!("{last}; trying again in {wait_s:.0} s"),
        }
    }

    /// Says what came of it.
    pub(crate) fn done(&self, report: &Report) {
        self.bar.finish_and_clear();
        if self.form == Form::Json {
            let mut line = json!(report);
            line["event"] = json!("done");
            println!("{line}");
            return;
        }
        let mb = report.sent_bytes as f64 / 1e6;
        println!(
            "complete: {} frames, {} sent now ({mb:.1} MB in {:.1} s)",
            report.frames, report.sent_frames, report.seconds
        );
        if report.sent_previews > 0 {
            println!("before them {} previews ({:.1} MB)", report.sent_previews, report.preview_bytes as f64 / 1e6);
        }
        println!(
            "ropeway     {}\nrope        {}\nacquisition {}",
            report.ropeway_id, report.rope_id, report.acquisition_id
        );
    }
}

fn sentence(tick: &Tick) -> String {
    let each: Vec<String> = tick.views.iter().map(|view| format!("{}/{}", view.held, view.frames)).collect();
    let frames = format!("{}/{} frames (views {})", tick.held, tick.frames, each.join(", "));
    match tick.stage {
        Stage::Announcing => format!("{frames}, reading and announcing"),
        Stage::Previewing => {
            format!("{}/{} previews, {:.2} MB/s", tick.previews, tick.frames, tick.mb_per_second)
        }
        Stage::Watching => format!("{frames}, all sent; waiting for more"),
        Stage::Sending => {
            let left = tick.seconds_left().map(time_left).filter(|words| !words.is_empty());
            let left = left.map_or_else(String::new, |words| format!(", {words}"));
            format!("{frames}, {:.2} MB/s{left}", tick.mb_per_second)
        }
    }
}
