//! `ropescope evaluate alignment`.

use super::provenance;
use crate::cli::run_progress::Watcher;
use anyhow::ensure;
use ropescope::experiments::alignment::{Plan, STAGE, report};
use std::path::PathBuf;

/// Writes a report about how exact lay lengths are, beside the Cramer-Rao bound.
///
/// Simulates the paper's experiments (section 6.3) and inspects them: errors over noise, tracking of a progression, three
/// sequences of a short rope, repeatability, recovery of a known deformation, lost locks at high noise. Writes report.md with
/// figures (SVG) and their numbers (CSV). The same options give the same figures.
#[derive(clap::Args)]
#[command(after_long_help = "Examples:
  ropescope evaluate alignment --out report --quick
      every part once, in about a minute
  ropescope evaluate alignment --out report
      as much rope as in the paper: hours
  ropescope evaluate alignment --out report --ropes 4 --metres 10
      what can be waited for")]
pub(crate) struct AlignmentArgs {
    /// Folder for the report; must be empty, hold an earlier report or not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Every part once, on little rope
    #[arg(long)]
    quick: bool,
    /// Every random choice follows from this number
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Ropes a noise level; five times as many deformations and ropes of high noise [default: 20, as the paper]
    #[arg(long, value_name = "N", conflicts_with = "quick")]
    ropes: Option<usize>,
    /// Length of a rope of a noise level [default: 30, as the paper]
    #[arg(long, value_name = "M", conflicts_with = "quick")]
    metres: Option<f64>,
}

/// Most ropes of a level: more would run for weeks.
const MOST_ROPES: usize = 1000;
/// Shortest and longest rope of a level in m: a few stretches at least.
const METRES: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// Runs the command.
pub(super) fn run(args: &AlignmentArgs) -> anyhow::Result<()> {
    let mut plan = if args.quick { Plan::quick(args.seed) } else { Plan::full(args.seed) };
    if let Some(ropes) = args.ropes {
        ensure!((1..=MOST_ROPES).contains(&ropes), "--ropes is {ropes}, but must lie between 1 and {MOST_ROPES}");
        plan.ropes = ropes;
    }
    if let Some(metres) = args.metres {
        let (least, most) = (METRES.start(), METRES.end());
        ensure!(METRES.contains(&metres), "--metres is {metres}, but must lie between {least} and {most}");
        plan.metres = metres;
    }
    let watcher = Watcher::start(false, &[STAGE])?;
    let written = report(&args.out, &plan, &provenance::now(), &watcher);
    watcher.done();
    println!("{}", written.map_err(provenance::told)?.display());
    Ok(())
}
