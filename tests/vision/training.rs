//! Training on several recordings of one rope, through everything a user would run but the command line.

use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::model_file::{Model, read_report};
use ropescope::pipeline::progress::{Progress, ProgressReport, Quiet};
use ropescope::pipeline::source::{Frame, SourceError};
use ropescope::pipeline::{
    Acquisition, FrameFiles, FrameSource, InspectOptions, PipelineError, TrainOptions, TrainReport, TrainingRange,
    inspect, train,
};
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Mutex, OnceLock};
use tempfile::TempDir;

/// Five stretches of 0.2 m, each a frame, in one view of few pixels, to be quick.
fn day() -> Recipe {
    Recipe { metres: 1.0, sensor_px: 240, rope_width_px: 190.0, view_angles_deg: vec![30.0], ..Recipe::photographic() }
}

/// A simulated recording; remembers which frames were decoded.
struct Recording {
    folder: TempDir,
    acquisition: Acquisition,
    frames: FrameFiles,
    decoded: Mutex<BTreeSet<usize>>,
    /// A view whose frames are black.
    dead_view: Option<usize>,
}

impl Recording {
    fn new(recipe: &Recipe, seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        write_acquisition(&Scene::new(recipe, seed).unwrap(), folder.path(), |_| {}).unwrap();
        let (acquisition, frames) = open_folder(folder.path()).unwrap();
        Self { folder, acquisition, frames, decoded: Mutex::default(), dead_view: None }
    }

    fn range<'a>(&'a self, name: &'a str, from_m: Option<f64>, to_m: Option<f64>) -> TrainingRange<'a> {
        TrainingRange { name, acquisition: &self.acquisition, source: self, from_m, to_m }
    }

    /// Mean line score under a model.
    fn mean_score(&self, model: &Path) -> f64 {
        let results = tempfile::tempdir().unwrap();
        let options = InspectOptions { model_path: Some(model.into()), ..InspectOptions::default() };
        inspect(&self.acquisition, &self.frames, &options, results.path(), &Quiet).unwrap();
        let table = std::fs::read_to_string(results.path().join("line_scores.csv")).unwrap();
        let scores = table.lines().skip(1).filter_map(|row| row.rsplit(',').next()?.parse::<f64>().ok());
        let scores: Vec<f64> = scores.collect();
        assert!(scores.len() > 8_000, "of 10,000 lines, {} were scored", scores.len());
        scores.iter().sum::<f64>() / scores.len() as f64
    }
}

impl FrameSource for Recording {
    fn views(&self) -> usize {
        self.frames.views()
    }

    fn frames(&self, view: usize) -> usize {
        self.frames.frames(view)
    }

    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
        self.frames.lines(view, frame)
    }

    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
        self.decoded.lock().unwrap().insert(frame);
        let mut loaded = self.frames.load(view, frame)?;
        if self.dead_view == Some(view) {
            loaded.pixels.fill(0);
        }
        Ok(loaded)
    }
}

/// Remembers the passes that a training made.
#[derive(Default)]
struct Passes(Mutex<BTreeSet<&'static str>>);

impl Progress for Passes {
    fn report(&self, report: ProgressReport) {
        self.0.lock().unwrap().insert(report.stage);
    }
}

/// A clean day and, of the same rope elsewhere, a dirty and dark one.
fn days() -> &'static [Recording; 2] {
    static DAYS: OnceLock<[Recording; 2]> = OnceLock::new();
    DAYS.get_or_init(|| {
        let clean = Recipe { dirt: 0.05, water: 0.0, ..day() };
        let dirty = Recipe { dirt: 0.9, exposure: 0.6, oil_spots_per_m: 6.0, start_m: 20.0, ..day() };
        [Recording::new(&clean, 5), Recording::new(&dirty, 6)]
    })
}

fn learn(ranges: &[TrainingRange<'_>], model: &Path) -> TrainReport {
    train(ranges, TrainOptions::default(), model, &Quiet).unwrap()
}

#[test]
fn two_days_of_one_rope_teach_one_model_that_knows_both() {
    let [clean, dirty] = days();
    let folder = tempfile::tempdir().unwrap();
    let (of_one, of_both) = (folder.path().join("one.model"), folder.path().join("both.model"));
    let one = learn(&[clean.range("clean", None, None)], &of_one);
    let both = learn(&[clean.range("clean", None, None), dirty.range("dirty", None, None)], &of_both);
    assert_eq!((one.learnt_from.len(), one.notes.iter().any(|note| note.contains("gave"))), (0, false));
    assert!((both.learnt_view_m - 2.0 * one.learnt_view_m).abs() < 0.21, "{both:?}"); // a stretch more or less
    assert!((both.budget.unwrap().held_back_m - 2.0 * one.budget.unwrap().held_back_m).abs() < 0.21);
    assert!(
        both.learning_curve.last().unwrap().metres > 1.1,
        "the curve goes on into the second day: {:?}",
        both.learning_curve
    );
    assert_eq!(read_report(&of_both).unwrap().learnt_from, both.learnt_from);
    Model::read(&of_both).unwrap().check(&dirty.acquisition).unwrap();
    // Rope that taught a model looks more intact to it than rope of a day that it has not seen.
    let (unseen, seen) = (dirty.mean_score(&of_one), dirty.mean_score(&of_both));
    assert!(
        seen < 0.9 * unseen,
        "mean line score of the second day: {seen} where it taught, {unseen} where it did not"
    );
}

#[test]
fn of_every_recording_only_its_own_range_is_looked_at() {
    let recipe = Recipe { metres: 1.2, ..day() };
    let may = Recording::new(&recipe, 7);
    let august = Recording::new(&Recipe { start_m: 20.0, ..recipe }, 8);
    let folder = tempfile::tempdir().unwrap();
    let ranges = [may.range("may", None, Some(0.8)), august.range("august", Some(20.4), None)];
    let report = learn(&ranges, &folder.path().join("rope.model"));
    assert_eq!(*may.decoded.lock().unwrap(), BTreeSet::from([0, 1, 2, 3]));
    assert_eq!(*august.decoded.lock().unwrap(), BTreeSet::from([2, 3, 4, 5]));
    let gave: Vec<_> = report.learnt_from.iter().map(|l| (l.acquisition.as_str(), l.from_m, l.to_m)).collect();
    assert_eq!(gave, [("may", 0.0, 0.8), ("august", 20.4, 21.2)]);
    assert!(report.learnt_from.iter().all(|l| l.learnt_view_m > 0.5), "{report:?}");
    assert_eq!((report.from_m, report.to_m), (0.0, 21.2));
    let note = "may (metre 0.00 to 0.80) gave 0.80 m of each view on average; august (metre 20.40 to 21.20) gave";
    assert!(report.notes.iter().any(|n| n.starts_with(note)), "{:?}", report.notes);
}

#[test]
fn another_construction_is_refused_by_name_and_nothing_is_written() {
    let [clean, _] = days();
    let other = Recording::new(&day().with_construction(6, 8, 32.0), 9);
    let folder = tempfile::tempdir().unwrap();
    let ranges = [clean.range("clean", None, None), other.range("other", None, None)];
    let error = train(&ranges, TrainOptions::default(), &folder.path().join("rope.model"), &Quiet).unwrap_err();
    assert!(matches!(error, PipelineError::AcquisitionsDiffer { .. }));
    let words =
        "other has a number of wires per strand of 8, but the first one has 9: one model is learnt from one rope";
    assert!(error.to_string().starts_with(words), "{error}");
    assert_eq!(*other.decoded.lock().unwrap(), BTreeSet::new(), "it costs nothing");
    let outside = [clean.range("clean", None, None), days()[1].range("dirty", None, Some(19.0))];
    let error = train(&outside, TrainOptions::default(), &folder.path().join("rope.model"), &Quiet).unwrap_err();
    let words = "the range of dirty, which shows rope metres 20.00 to 21.00";
    assert!(error.to_string().contains(words), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    assert!(other.folder.path().is_dir());
}

#[test]
fn a_view_that_shows_nothing_is_named_after_the_first_pass() {
    let recipe = Recipe { view_angles_deg: vec![30.0, 120.0], ..day() };
    let recording = Recording { dead_view: Some(1), ..Recording::new(&recipe, 10) };
    let folder = tempfile::tempdir().unwrap();
    let (range, passes) = (recording.range("may", None, None), Passes::default());
    let error = train(&[range], TrainOptions::default(), &folder.path().join("rope.model"), &passes).unwrap_err();
    assert!(matches!(&error, PipelineError::ViewsGaveTooLittle { views, .. } if views[..] == [(1, 0.0)]), "{error}");
    let said = error.to_string();
    assert!(said.starts_with("view 1 gave only 0.00 m") && said.contains("mend the camera, or leave that view out"));
    assert_eq!(*passes.0.lock().unwrap(), BTreeSet::from(["learn"]));
}
