//! `ropescope evaluate detection`.

use super::provenance;
use crate::cli::run_progress::Watcher;
use anyhow::ensure;
use ropescope::experiments::detection::{Plan, STAGE, report, report_recording};
use std::path::PathBuf;

/// Writes a report about how surely defects are found, and what that costs in rope to look at again.
///
/// Simulates the paper's experiment (section 6.4): trains on 5 m of intact rope, inspects 395 m with 37 defects in four views,
/// and writes report.md with ROC curves per view and averaged, the 50 % recovery of the paper, every defect by kind and severity,
/// metres to look at again, and all configurations from the paper's to ours. Frames are never written to the disk. With --recording and
/// --results, the report is about a recording that has labels and was inspected with a model.
#[derive(clap::Args)]
#[command(after_long_help = "Examples:
  ropescope evaluate detection --out report --quick
      in about a minute, on little rope
  ropescope evaluate detection --out report
      as much rope as in the paper
  ropescope evaluate detection --out report --metres 40
      the same defects closer together
  ropescope evaluate detection --out report --recording rope-a --results results --skip-lines 40000
      a recording with labels.json, of which the first 4 m were trained on")]
pub(crate) struct DetectionArgs {
    /// Folder for the report; must be empty, hold an earlier report or not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// On little rope
    #[arg(long)]
    quick: bool,
    /// Every random choice follows from this number
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Length of the rope, the first 5 m of which are trained on [default: 400]
    #[arg(long, value_name = "M", conflicts_with = "quick")]
    metres: Option<f64>,
    /// Number of defects [default: 37]
    #[arg(long, value_name = "N", conflicts_with = "quick")]
    defects: Option<usize>,
    /// Leave out the simpler configurations, from the paper's to ours, that judge the rope beside it
    #[arg(long)]
    no_ablation: bool,
    /// A recording with labels.json, instead of a simulated rope
    #[arg(long, value_name = "DIR", requires = "results", conflicts_with_all = ["quick", "seed", "metres", "defects", "no_ablation"])]
    recording: Option<PathBuf>,
    /// Its results folder, as `inspect --model` writes it
    #[arg(long, value_name = "RESULTS", requires = "recording")]
    results: Option<PathBuf>,
    /// Lines at the beginning of the recording that its model was trained on
    #[arg(long, value_name = "N", requires = "recording", default_value_t = 0)]
    skip_lines: usize,
}

/// Least rope behind the training part in m.
const LEAST_TEST_M: f64 = 1.0;
/// Longest rope in m: the scores of all lines are in memory when they are judged.
const MOST_M: f64 = 1000.0;

/// Runs the command.
pub(super) fn run(args: &DetectionArgs) -> anyhow::Result<()> {
    let made = provenance::now();
    let written = if let (Some(recording), Some(results)) = (&args.recording, &args.results) {
        report_recording(&args.out, recording, results, args.skip_lines, &made)
    } else {
        let plan = plan(args)?;
        let watcher = Watcher::start(false, &[STAGE])?;
        let written = report(&args.out, &plan, &made, &watcher);
        watcher.done();
        written
    };
    println!("{}", written.map_err(provenance::told)?.display());
    Ok(())
}

fn plan(args: &DetectionArgs) -> anyhow::Result<Plan> {
    let mut plan = if args.quick { Plan::quick(args.seed) } else { Plan::full(args.seed) };
    if let Some(metres) = args.metres {
        let least = plan.train_m + LEAST_TEST_M;
        ensure!((least..=MOST_M).contains(&metres), "--metres is {metres}, but must lie between {least} and {MOST_M}");
        plan.metres = metres;
    }
    if let Some(defects) = args.defects {
        ensure!(defects > 0, "--defects is 0, but without defects nothing can be found: give at least 1");
        plan.defects = defects;
    }
    plan.ablation = !args.no_ablation;
    Ok(plan)
}
