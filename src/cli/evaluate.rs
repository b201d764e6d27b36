//! `ropescope evaluate`.

use ropescope::evaluate::evaluate;
use std::io::Write;
use std::path::PathBuf;

/// Scores results against truth.
///
/// Reads truth_lines.csv, truth_wires.csv and labels.json beside a recording, and lay_lengths.csv, displacement.csv,
/// line_scores.csv and defects.json of a results folder; each is optional. Prints errors of lay lengths and displacement,
/// the ROC of the lines per view and over all, the false alarms that 50 % recovery of the defects costs, and what the
/// decisions found, missed and cost in metres to inspect again.
#[derive(clap::Args)]
pub(crate) struct EvaluateArgs {
    /// The recording: an acquisition folder with its truth
    #[arg(value_name = "DIR")]
    recording: PathBuf,
    /// The results folder, as `inspect --out` writes it
    #[arg(value_name = "RESULTS")]
    results: PathBuf,
    /// Lines at the beginning that do not count for detection: the part the model was trained on
    #[arg(long, value_name = "N", default_value_t = 0)]
    skip_lines: usize,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub(crate) fn run(args: EvaluateArgs) -> anyhow::Result<()> {
    let evaluation = evaluate(&args.recording, &args.results, args.skip_lines)?;
    let mut out = std::io::stdout().lock();
    if args.json {
        serde_json::to_writer_pretty(&mut out, &evaluation)?;
        writeln!(out)?;
    } else {
        write!(out, "{evaluation}")?;
    }
    Ok(())
}
