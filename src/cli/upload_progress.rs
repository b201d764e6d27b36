//! How an upload shows where it stands, every view and in all: bars on a terminal, plain lines elsewhere, JSON for scripts.

use super::time_left::time_left;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use ropescope::upload::{Report, Stage, Tick, ViewTick};
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
    /// Bars on stderr: of all frames, and of each view.
    Bars,
    /// Lines on stderr.
    Lines,
    /// JSON objects on stdout.
    Json,
}

impl Form {
    /// JSON when asked for, bars when a person watches.
    pub(crate) fn choose(json: bool) -> Self {
        match (json, std::io::stderr().is_terminal()) {
            (true, _) => Self::Json,
            (false, true) => Self::Bars,
            (false, false) => Self::Lines,
        }
    }
}

/// Shows the progress of one upload.
pub(crate) struct Watcher {
    form: Form,
    bars: MultiProgress,
    all: ProgressBar,
    views: Mutex<Vec<ProgressBar>>,
    last_line_s: Mutex<Option<(f64, Stage)>>,
    last_wait: Mutex<Option<Instant>>,
}

impl Watcher {
    /// Nothing is shown before the first tick.
    pub(crate) fn new(form: Form) -> Self {
        let target = if form == Form::Bars { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bars = MultiProgress::with_draw_target(target);
        let all = bars.add(bar());
        Self { form, bars, all, views: Mutex::default(), last_line_s: Mutex::new(None), last_wait: Mutex::new(None) }
    }

    /// Takes the state after a frame.
    pub(crate) fn tick(&self, tick: &Tick) {
        match self.form {
            Form::Json => {
                let mut line = json!(tick);
                line["event"] = json!("progress");
                line["seconds_left"] = json!(tick.seconds_left());
                for (number, view) in tick.views.iter().enumerate() {
                    line["views"][number]["seconds_left"] = json!(view.seconds_left());
                }
                println!("{line}");
            }
            Form::Bars => {
                self.all.set_length(tick.bytes.max(1));
                self.all.set_position(tick.sent_bytes);
                self.all.set_message(sentence(tick));
                let Ok(mut bars) = self.views.lock() else { return };
                for (number, view) in tick.views.iter().enumerate() {
                    if bars.len() <= number {
                        bars.push(self.bars.add(bar()));
                    }
                    bars[number].set_length(view.frames.max(1) as u64);
                    bars[number].set_position(view.held as u64);
                    bars[number].set_message(of_view(number, view));
                }
            }
            Form::Lines => {
                let Ok(mut last_s) = self.last_line_s.lock() else { return };
                let due = last_s.is_none_or(|(last_s, stage)| {
                    tick.seconds - last_s >= LINE_EVERY_S || stage != tick.stage && tick.stage != Stage::Announcing
                });
                if due {
                    *last_s = Some((tick.seconds, tick.stage));
                    let views: Vec<String> = tick.views.iter().enumerate().map(|(n, view)| of_view(n, view)).collect();
                    eprintln!("{} ({})", sentence(tick), views.join("; "));
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
            // A terminal that is gone hears nothing.
            Form::Bars => drop(self.bars.println(format!("{last}; trying again in {wait_s:.0} s"))),
            Form::Lines => eprintln!("{last}; trying again in {wait_s:.0} s"),
        }
    }

    /// Says what came of it.
    pub(crate) fn done(&self, report: &Report) {
        // Bars that cannot be cleared only look untidy.
        drop(self.bars.clear());
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

fn bar() -> ProgressBar {
    let bar = ProgressBar::no_length();
    if let Ok(style) = ProgressStyle::with_template("{bar:32} {percent:>3} %  {wide_msg}") {
        bar.set_style(style);
    }
    bar
}

fn sentence(tick: &Tick) -> String {
    let frames = format!("{}/{} frames", tick.held, tick.frames);
    match tick.stage {
        Stage::Announcing => format!("{frames}, reading and announcing"),
        Stage::Previewing => {
            format!("{}/{} previews, {:.2} MB/s", tick.previews, tick.frames, tick.mb_per_second)
        }
        Stage::Watching => format!("{frames}, all sent; waiting for more"),
        Stage::Sending => format!("{frames}{}", pace(tick.mb_per_second, tick.seconds_left())),
    }
}

fn of_view(number: usize, view: &ViewTick) -> String {
    format!("view {number}: {}/{}{}", view.held, view.frames, pace(view.mb_per_second, view.seconds_left()))
}

fn pace(mb_per_second: f64, seconds_left: Option<f64>) -> String {
    let left = seconds_left.map(time_left).filter(|words| !words.is_empty());
    format!(", {mb_per_second:.2} MB/s{}", left.map_or_else(String::new, |words| format!(", {words}")))
}
