//! `ropescope train`.

use super::recording::Recording;
use super::run_progress::{Watcher, say};
use anyhow::{Context, bail, ensure};
use ropescope::pipeline::learning_curve::sentence;
use ropescope::pipeline::train::{PASSES, is_model};
use ropescope::pipeline::{Budget, TrainOptions, TrainReport, train};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

/// Learns how intact rope looks and writes it as a model.
///
/// DIR is an acquisition folder: rope.json and the frames of each view (view0/frame_000000.png, ...). Everything between
/// --from-m and --to-m counts as intact, dirt and oil included: what the model has seen is no anomaly afterwards. A few
/// metres of each rope are enough; for the threshold, every part is judged by what the others taught.
#[derive(clap::Args)]
#[command(after_long_help = "Examples:
  ropescope train intact --out rope.model
      the whole acquisition is known to be intact
  ropescope train rope-a --out rope-a.model --to-m 4
      only its first four metres are; inspect the rest with the model
  ropescope train rope-a --out rope-a.model --to-m 4 --false-defects-per-100m 10
      a lower threshold: more defects are found, and more that are none
  ropescope train rope-a --out rope-a.model --from-m 120 --to-m 125 --json
      rope metres, as start_m in rope.json counts them; for scripts

The model is written whole or not at all. Ctrl-C stops the run; exit codes: 0 done, 1 failed, 2 wrong arguments, 130 stopped.")]
pub(crate) struct TrainArgs {
    /// The acquisition folder
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The model file to write; an earlier model is replaced
    #[arg(long, value_name = "MODEL")]
    out: PathBuf,
    /// Rope metre from which on the rope is intact [default: the beginning]
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    from_m: Option<f64>,
    /// Rope metre up to which it is [default: the end]
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    to_m: Option<f64>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// One JSON object on standard output, progress as JSON lines on standard error
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
#[group(multiple = false)]
struct BudgetArgs {
    /// What false alarms may cost, in false defects per 100 m of intact rope [default: 2]
    #[arg(long, value_name = "N")]
    false_defects_per_100m: Option<f64>,
    /// The same in metres to look at in vain, with 5 cm on either side of a false defect
    #[arg(long, value_name = "M")]
    reinspect_m_per_100m: Option<f64>,
}

impl BudgetArgs {
    fn budget(&self) -> anyhow::Result<Budget> {
        let budget = match (self.false_defects_per_100m, self.reinspect_m_per_100m) {
            (Some(n), _) => Budget::FalseDefects(n),
            (None, Some(m)) => Budget::ReinspectM(m),
            (None, None) => Budget::default(),
        };
        budget.false_defects().map_err(anyhow::Error::msg)?;
        Ok(budget)
    }
}

/// Runs the command.
pub(crate) fn run(args: TrainArgs) -> anyhow::Result<()> {
    let budget = args.budget.budget()?;
    check_out(&args)?;
    let recording = Recording::open(&args.folder)?;
    check_range(&args, &recording)?;
    let watcher = Watcher::start(args.json, &PASSES)?;
    if !args.json {
        say(&format!("{}: {}", args.folder.display(), recording.describe()));
    }
    let options = TrainOptions { from_m: args.from_m, to_m: args.to_m, budget };
    let trained = train(&recording.acquisition, &recording.frames, options, &args.out, &watcher);
    watcher.done();
    let report = trained?;
    let bytes = std::fs::metadata(&args.out).with_context(|| args.out.display().to_string())?.len();
    let mut out = std::io::stdout().lock();
    if args.json {
        writeln!(out, "{}", json!({"event": "done", "model": args.out, "bytes": bytes, "report": report}))?;
    } else {
        write!(out, "{}", summary(&args, &report, recording.acquisition.view_angles_rad.len(), bytes))?;
    }
    Ok(())
}

/// Refuses what would fail only after minutes, or replace something that is no model.
fn check_out(args: &TrainArgs) -> anyhow::Result<()> {
    let out = &args.out;
    let name = out.display();
    ensure!(
        !out.is_dir(),
        "--out {name} is a folder, but a model is a file, such as {}",
        out.join("rope.model").display()
    );
    if out.exists() && !is_model(out) {
        bail!("--out {name} exists and is no model: choose another name, or remove it");
    }
    let parent = out.parent().filter(|p| !p.as_os_str().is_empty());
    if let Some(parent) = parent {
        ensure!(parent.is_dir(), "--out {name}: there is no folder {}; make it first", parent.display());
    }
    Ok(())
}

fn check_range(args: &TrainArgs, recording: &Recording) -> anyhow::Result<()> {
    let (start_m, end_m) = (recording.acquisition.start_m, recording.end_m());
    for (option, value) in [("--from-m", args.from_m), ("--to-m", args.to_m)] {
        let Some(value) = value else { continue };
        ensure!(
            (start_m..=end_m).contains(&value),
            "{option} is {value}, but the acquisition shows rope metres {start_m:.2} to {end_m:.2}"
        );
    }
    let (from_m, to_m) = (args.from_m.unwrap_or(start_m), args.to_m.unwrap_or(end_m));
    ensure!(from_m < to_m, "--from-m is {from_m}, but must be less than --to-m, which is {to_m}");
    Ok(())
}

fn summary(args: &TrainArgs, report: &TrainReport, views: usize, bytes: u64) -> String {
    let metres = report.to_m - report.from_m;
    let mut text = format!(
        "learnt      {}: {metres:.2} m in {:.1} s ({:.2} m/s), metre {:.2} to {:.2}; learnt from {:.2} m of each view on average\n\
         threshold   line score {:.3}: {}\n",
        report.construction,
        report.seconds,
        metres / report.seconds.max(1e-9),
        report.from_m,
        report.to_m,
        report.learnt_view_m / views.max(1) as f64,
        report.threshold,
        report.threshold_origin,
    );
    if let Some(fit) = &report.budget {
        text += &format!(
            "look again  line score {:.3}: {} false places per 100 m, {:.1} to {:.1} with 95 %\n",
            fit.look_again.line_score,
            fit.look_again.false_defects_per_100m,
            fit.look_again.at_least_per_100m,
            fit.look_again.at_most_per_100m,
        );
    }
    if let Some(sentence) = sentence(&report.learning_curve) {
        let points: Vec<String> =
            report.learning_curve.iter().map(|p| format!("{:.2} m {:.3}", p.metres, p.nats_per_pixel)).collect();
        text += &format!("enough?     {sentence} (nats per held-back pixel: {})\n", points.join(", "));
    }
    for note in &report.notes {
        text += &format!("note        {note}\n");
    }
    text + &format!("model       {} ({:.1} MB)\n", args.out.display(), bytes as f64 / 1e6)
}
