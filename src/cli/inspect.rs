//! `ropescope inspect`.

use super::cards::Cards;
use super::inspect_report::Report;
use super::printing::print_result;
use super::recording::Recording;
use super::results_out::ResultsOut;
use super::run_progress::{Watcher, say};
use super::{given_contours, surface_alarms_out};
use anyhow::{Context, ensure};
use clap::ValueEnum;
use ropescope::pipeline::results::{LineScoreFormat, Summary, Threshold};
use ropescope::pipeline::{InspectOptions, inspect};
use ropescope::workers::results_folder;
use std::path::{Path, PathBuf};

/// Stages of the pipeline, in order.
const STAGES: &[&str] = &["inspect"];

/// Measures lay lengths and, with a model, finds defects.
///
/// DIR is an acquisition folder: rope.json and the frames of each view (view0/frame_000000.png, ...). RESULTS gets
/// lay_lengths.csv, displacement.csv and summary.json; with --model also line_scores.csv, defects.json, look_again.json and
/// surface_alarms.csv (surface alarms, which are no broken wires, per window of 6, 30, 40 and 500 diameters and of a lay). What could not be
/// measured is left empty with a reason, and what was not inspected is listed in metres: it is not intact, it is unknown.
#[derive(clap::Args)]
#[command(after_long_help = "Examples:
  ropescope inspect rope-a --out lay
      lay lengths only
  ropescope train rope-a --to-m 4 --out rope-a.model
  ropescope inspect rope-a --model rope-a.model --out results --maps
      lay lengths, defects and likelihood maps
  ropescope inspect rope-a --model rope-a.model --out results --cards
      lay lengths, defects and a card of each
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
    /// Write a card of every defect as cards/defect_0.png, ...: one picture that says why it is one. Takes seconds a defect
    #[arg(long, requires = "model")]
    cards: bool,
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
        model_path: args.model.clone(),
        maps: args.maps || args.cards, // cards show them
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
    let run =
        Run { args: &args, recording: &recording, options: &options, results: results.partial(), watcher: &watcher };
    let ran = run.to_the_end();
    watcher.done();
    let summary = ran?;
    results.put_in_place()?;
    let report = Report::gather(&args.out, &recording.acquisition, summary)?;
    if args.json { print_result(serde_json::to_string(&report)? + "\n") } else { print_result(report) }
}

/// A run of the command, up to results that are whole and wait to be put in place.
struct Run<'a> {
    args: &'a InspectArgs,
    recording: &'a Recording,
    options: &'a InspectOptions,
    results: &'a Path,
    watcher: &'a Watcher,
}

impl Run<'_> {
    fn to_the_end(&self) -> anyhow::Result<Summary> {
        let Self { args, recording, options, results, watcher } = *self;
        let summary = inspect(&recording.acquisition, &recording.frames, options, results, watcher)?;
        let Some(model) = &args.model else { return Ok(summary) };
        let lay_lengths = results_folder::lay_lengths(results).context("the results cannot be read back")?;
        let defects = results_folder::defects(results).context("the results cannot be read back")?;
        surface_alarms_out::write(results, &recording.acquisition, &summary, &lay_lengths, &defects)?;
        if args.cards {
            let rope = args.folder.file_name().unwrap_or(args.folder.as_os_str()).to_string_lossy();
            let given_contours = options.given_contours.as_deref();
            let threshold = summary.threshold.as_ref().map(|t| t.line_score);
            Cards { recording, rope: &rope, model, given_contours, threshold, watcher }.write(results, &defects)?;
            if !args.maps {
                let maps = results.join("maps");
                std::fs::remove_dir_all(&maps).with_context(|| format!("cannot remove {}", maps.display()))?;
            }
        }
        Ok(summary)
    }
}
