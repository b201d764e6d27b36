//! `ropescope train`.

use super::printing::print_result;
use super::run_progress::{Watcher, say};
use super::train_ranges::{Bound, TrainFolder, from_m, to_m, wrong_count};
use anyhow::{Context, bail, ensure};
use clap::Args;
use clap::error::ErrorKind;
use ropescope::pipeline::learning_curve::sentence;
use ropescope::pipeline::train::{PASSES, is_model};
use ropescope::pipeline::{BandwidthsBy, Budget, TrainOptions, TrainReport, train};
use serde_json::json;
use std::path::PathBuf;

/// Learns how intact rope looks and writes it as a model.
///
/// DIR is an acquisition folder: rope.json and the frames of each view (view0/frame_000000.png, ...). Everything between
/// --from-m and --to-m counts as intact, dirt and oil included: what the model has seen is no anomaly afterwards. A few
/// metres of each rope are enough; for the threshold, every part is judged by what the others taught.
///
/// Several folders are recordings of one rope by one camera head, on other days: what they show is learnt as one, so that
/// the light and the dirt of each are known. --from-m and --to-m then repeat, once for each folder in their order.
#[derive(Args)]
#[command(after_long_help = "Examples:
  ropescope train intact --out rope.model
      the whole acquisition is known to be intact
  ropescope train rope-a --out rope-a.model --to-m 4
      only its first four metres are; inspect the rest with the model
  ropescope train rope-a --out rope-a.model --to-m 4 --false-defects-per-100m 10
      a lower threshold: more defects are found, and more that are none
  ropescope train rope-a --out rope-a.model --from-m 120 --to-m 125 --json
      rope metres, as start_m in rope.json counts them; for scripts
  ropescope train may august october --out rope.model
      three days, all of each
  ropescope train may august --out rope.model --from-m 12 --to-m 14 --from-m start --to-m 3.5
      of may metres 12 to 14, of august everything up to metre 3.5

The model is written whole or not at all. Ctrl-C stops the run; exit codes: 0 done, 1 failed, 2 wrong arguments, 130 stopped.")]
pub(crate) struct TrainArgs {
    /// The acquisition folders, all of one rope
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,
    /// The model file to write; an earlier model is replaced
    #[arg(long, value_name = "MODEL")]
    out: PathBuf,
    /// Rope metre from which on the rope is intact, or 'start'; once for each folder, in their order [default: the beginning]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = from_m)]
    from_m: Vec<Bound>,
    /// Rope metre up to which it is, or 'end'; once for each folder, in their order [default: the end]
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = to_m)]
    to_m: Vec<Bound>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// How smoothly gray values are learnt: chosen by how well rope that did not teach is predicted, or the same for all ropes
    #[arg(long, value_enum, value_name = "BY", default_value = "held-out")]
    bandwidths: BandwidthsArg,
    /// One JSON object on standard output, progress as JSON lines on standard error
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
#[group(multiple = false)]
struct BudgetArgs {
    /// What false alarms may cost, in false defects per 100 m of intact rope [default: 2]
    #[arg(long, value_name = "N")]
    false_defects_per_100m: Option<f64>,
    /// The same in metres to look at in vain, a false defect with its 5 cm of context being 6 cm
    #[arg(long, value_name = "M")]
    reinspect_m_per_100m: Option<f64>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum BandwidthsArg {
    HeldOut,
    Fixed,
}

impl From<BandwidthsArg> for BandwidthsBy {
    fn from(by: BandwidthsArg) -> Self {
        match by {
            BandwidthsArg::HeldOut => Self::HeldOut,
            BandwidthsArg::Fixed => Self::Fixed,
        }
    }
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
    check_counts(&args);
    let options = TrainOptions { budget: args.budget.budget()?, bandwidths: args.bandwidths.into() };
    check_out(&args)?;
    let folders = TrainFolder::open_all(&args.folders, &args.from_m, &args.to_m)?;
    let watcher = Watcher::start(args.json, &PASSES)?;
    if !args.json {
        folders.iter().for_each(|folder| say(&format!("{}: {}", folder.name, folder.recording.describe())));
    }
    let ranges: Vec<_> = folders.iter().map(TrainFolder::range).collect();
    let trained = train(&ranges, options, &args.out, &watcher);
    watcher.done();
    let report = trained?;
    let bytes = std::fs::metadata(&args.out).with_context(|| args.out.display().to_string())?.len();
    if args.json {
        let done = json!({"event": "done", "model": args.out, "bytes": bytes, "report": report});
        return print_result(format_args!("{done}\n"));
    }
    print_result(summary(&args, &report, folders[0].recording.acquisition.view_angles_rad.len(), bytes))
}

/// Ends the program as wrong arguments do if bounds cannot be matched to folders.
fn check_counts(args: &TrainArgs) {
    let folders = args.folders.len();
    let wrong = wrong_count("--from-m", "start", args.from_m.len(), folders)
        .or_else(|| wrong_count("--to-m", "end", args.to_m.len(), folders));
    if let Some(wrong) = wrong {
        let mut command = TrainArgs::augment_args(clap::Command::new("ropescope train"));
        command.error(ErrorKind::WrongNumberOfValues, wrong).exit();
    }
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

fn summary(args: &TrainArgs, report: &TrainReport, views: usize, bytes: u64) -> String {
    let (metres, place) = match &report.learnt_from[..] {
        [] => (report.to_m - report.from_m, format!("metre {:.2} to {:.2}", report.from_m, report.to_m)),
        ranges => (ranges.iter().map(|r| r.to_m - r.from_m).sum(), format!("{} recordings", ranges.len())),
    };
    let mut text = format!(
        "learnt      {}: {metres:.2} m in {:.1} s ({:.2} m/s), {place}; learnt from {:.2} m of each view on average\n\
         threshold   line score {:.3}: {}\n",
        report.construction,
        report.seconds,
        metres / report.seconds.max(1e-9),
        report.learnt_view_m / views.max(1) as f64,
        report.threshold,
        report.threshold_origin,
    );
    if let Some(fit) = &report.budget {
        text += &format!(
            "look again  line score {:.3}: {:.1} false places per 100 m, {:.1} to {:.1} with 95 %\n",
            fit.look_again.line_score,
            fit.look_again.false_defects_per_100m,
            fit.look_again.at_least_per_100m,
            fit.look_again.at_most_per_100m,
        );
    }
    if let Some(fit) = &report.bandwidths {
        text += &format!("bandwidths  {}\n", fit.sentence());
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
