//! `ropescope inspect`.

use super::given_contours;
use super::inspect_report::Report;
use super::printing::print_result;
use super::recording::Recording;
use super::results_out::ResultsOut;
use super::run_progress::{Watcher, say};
use anyhow::ensure;
use clap::ValueEnum;
use ropescope::pipeline::results::{LineScoreFormat, Threshold};
use ropescope::pipeline::{InspectOptions, inspect};
use std::path::PathBuf;

/// Stages of the pipeline, in order.
const STAGES: &[&str] = &["inspect"];

/// Measures lay lengths and, with a model, finds defects.
///
/// DIR is an acquisition folder: rope.json and the frames of each view (view0/frame_000000.png, ...). RESULTS gets
/// lay_lengths.csv, displacement.csv and summary.json; with --model also line_scores.csv, defects.json and look_again.json. What could not be
/// measured is left empty with a reason, and what was not inspected is listed in metres: it is not intact, it is unknown.
#[derive(clap::Args)]
#[command(after_long_help = "Examples:
  ropescope inspect rope-a --out lay
      lay lengths only
  ropescope train rope-a --to-m 4 --out rope-a.model
  ropescope inspect rope-a --model rope-a.model --out results --maps
      lay lengths, defects and likelihood maps
  ropescope inspect rope-a --model rope-a.model --out results-2 --threshold 6.5
      fewer alarms than the model's own threshold gives
  ropescope inspect paper --contours given --out results
      rope edges from contours0.csv, ... (line,lower_px,upper_px) beside rope.json instead of the images

Earlier results in RESULTS are replaced, and only by whole ones. Ctrl-C stops the run; exit codes: 0 done, 1 failed,
2 wrong arguments, 130 stopped.")]
pub(crate) struct InspectArgs {
    /// The acquisition folder
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Model of this rope, as `train` writes it; without one, only lay lengths are measured
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Folder for the results; must be empty, hold earlier results or not exist, unless --force is given
    #[arg(long, value_name = "RESULTS")]
    out: PathBuf,
    /// Write results into a folder that holds other files
    #[arg(long)]
    force: bool,
    /// Write likelihood maps as maps/view0/frame_000000.png, ...: dark is unlikely, black raises an alarm by
    /// the model's own threshold, transparent was not judged
    #[arg(long, requires = "model")]
    maps: bool,
    /// Where the edges of the rope come from
    #[arg(long, value_enum, default_value = "measured")]
    contours: ContoursArg,
    /// Line score above which a line is an alarm [default: the model's own]
    #[arg(long, value_name = "SCORE", requires = "model", allow_negative_numbers = true)]
    threshold: Option<f64>,
    /// Line score above which a place is worth looking at again [default: as far under the threshold as the model's own]
    #[arg(long, value_name = "SCORE", requires = "threshold", allow_negative_numbers = true)]
    look_again: Option<f64>,
    /// One JSON object on standard output, progress as JSON lines on standard error
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ContoursArg {
    /// Measured in the images
    Measured,
    /// Read from contours0.csv, ... beside rope.json
    Given,
}

/// Runs the command.
pub(crate) fn run(args: InspectArgs) -> anyhow::Result<()> {
    if let Some(threshold) = args.threshold {
        ensure!(threshold.is_finite(), "--threshold is {threshold}, but must be a finite number");
    }
    if let (Some(again), Some(threshold)) = (args.look_again, args.threshold) {
        ensure!(again <= threshold, "--look-again is {again}, but must not be over --threshold, which is {threshold}");
    }
    let recording = Recording::open(&args.folder)?;
    let given_contours = match args.contours {
        ContoursArg::Measured => None,
        ContoursArg::Given => Some(given_contours::read(&args.folder, &recording)?),
    };
    let results = ResultsOut::prepare(&args.out, args.force)?;
    let options = InspectOptions {
        model_path: args.model,
        maps: args.maps,
        threshold: args
            .threshold
            .map(|score| Threshold { look_again_line_score: args.look_again, ..Threshold::by_hand(score) }),
        line_scores: LineScoreFormat::Csv,
        given_contours,
    };
    let watcher = Watcher::start(args.json, STAGES)?;
    if !args.json {
        say(&format!("{}: {}", args.folder.display(), recording.describe()));
    }
    let inspected = inspect(&recording.acquisition, &recording.frames, &options, results.partial(), &watcher);
    watcher.done();
    let summary = inspected?;
    results.put_in_place()?;
    let report = Report::gather(&args.out, &recording.acquisition, summary)?;
    if args.json { print_result(serde_json::to_string(&report)? + "\n") } else { print_result(report) }
}
