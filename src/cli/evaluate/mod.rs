//! `ropescope evaluate`: results against truth, and the paper's experiments as reports.

mod alignment;
mod detection;
mod provenance;

use super::printing::print_result;
use ropescope::evaluate::evaluate;
use std::path::PathBuf;

/// Scores results against truth, or runs the paper's experiments.
///
/// Reads truth_lines.csv, truth_wires.csv and labels.json beside a recording, and lay_lengths.csv, displacement.csv,
/// line_scores.csv and defects.json of a results folder; each is optional. Prints errors of lay lengths and displacement,
/// how often the truth lies within the stated standard deviations of lay lengths, phases, diameter, ovality and looseness,
/// the ROC of the lines per view and over all, the false alarms that 50 % recovery of the defects costs, and what the
/// decisions found, missed and cost in metres to inspect again.
///
/// The commands below simulate ropes, inspect them and write a report with figures. (A recording of the name of a command is
/// given as ./alignment.)
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, disable_help_subcommand = true)]
pub(crate) struct EvaluateArgs {
    #[command(subcommand)]
    report: Option<ReportCommand>,
    /// The recording: an acquisition folder with its truth
    #[arg(value_name = "DIR", required = true)]
    recording: Option<PathBuf>,
    /// The results folder, as `inspect --out` writes it
    #[arg(value_name = "RESULTS", required = true)]
    results: Option<PathBuf>,
    /// Lines at the beginning that do not count for detection: the part the model was trained on
    #[arg(long, value_name = "N", default_value_t = 0)]
    skip_lines: usize,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(clap::Subcommand)]
enum ReportCommand {
    Alignment(alignment::AlignmentArgs),
    Detection(detection::DetectionArgs),
}

/// Runs the command.
pub(crate) fn run(args: EvaluateArgs) -> anyhow::Result<()> {
    match args.report {
        Some(ReportCommand::Alignment(args)) => return alignment::run(&args),
        Some(ReportCommand::Detection(args)) => return detection::run(&args),
        None => {}
    }
    let (Some(recording), Some(results)) = (args.recording, args.results) else {
        anyhow::bail!("evaluate needs DIR and RESULTS");
    };
    let evaluation = evaluate(&recording, &results, args.skip_lines)?;
    if args.json { print_result(serde_json::to_string_pretty(&evaluation)? + "\n") } else { print_result(evaluation) }
}
