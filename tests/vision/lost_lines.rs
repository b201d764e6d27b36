//! A camera that loses lines: what it lost is listed and not judged, and nothing else suffers.

use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::progress::Quiet;
use ropescope::pipeline::results::Summary;
use ropescope::pipeline::source::{Frame, SourceError};
use ropescope::pipeline::{
    Acquisition, FrameFiles, FrameSource, InspectOptions, TrainOptions, TrainReport, TrainingRange, inspect, train,
};
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

/// Lines of a frame.
const FRAME: usize = 2000;

#[derive(Clone, Copy)]
enum Loss {
    Black,
    Saturated,
    Repeated,
}

/// What view 0 loses; black lines are lost by all views.
const LOST: [(Range<usize>, Loss); 5] = [
    (2500..2503, Loss::Black),
    (4600..4630, Loss::Repeated),
    (6300..6600, Loss::Saturated),
    (7000..7001, Loss::Repeated),
    (10_000..12_600, Loss::Black),
];

/// Frames of which lines were lost on their way from the camera.
struct Losing<'a> {
    frames: &'a FrameFiles,
    lost: &'a [(Range<usize>, Loss)],
}

impl FrameSource for Losing<'_> {
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
        let mut loaded = self.frames.load(view, frame)?;
        let width = loaded.width;
        for (lines, loss) in self.lost.iter().filter(|(_, loss)| view == 0 || matches!(loss, Loss::Black)) {
            for line in lines.clone().filter(|line| line / FRAME == frame) {
                let at = line % FRAME * width;
                match loss {
                    Loss::Black => loaded.pixels[at..at + width].fill(0),
                    Loss::Saturated => loaded.pixels[at..at + width].fill(255),
                    Loss::Repeated => loaded.pixels.copy_within(at - width..at, at),
                }
            }
        }
        Ok(loaded)
    }
}

fn learn(acquisition: &Acquisition, source: &dyn FrameSource, model: &Path) -> TrainReport {
    let range = TrainingRange { name: "rope", acquisition, source, from_m: None, to_m: None };
    train(&[range], TrainOptions::default(), model, &Quiet).unwrap()
}

/// Line scores by view and line, and the summary.
fn inspected(
    acquisition: &Acquisition,
    source: &dyn FrameSource,
    model: &Path,
) -> (BTreeMap<(usize, usize), f64>, Summary) {
    let results = tempfile::tempdir().unwrap();
    let options = InspectOptions { model_path: Some(model.into()), ..InspectOptions::default() };
    let summary = inspect(acquisition, source, &options, results.path(), &Quiet).unwrap();
    let table = std::fs::read_to_string(results.path().join("line_scores.csv")).unwrap();
    let row = |row: &str| {
        let cells: Vec<&str> = row.split(',').collect();
        Some(((cells[0].parse().ok()?, cells[1].parse().ok()?), cells[2].parse().ok()?))
    };
    (table.lines().skip(1).filter_map(row).collect(), summary)
}

#[test]
fn lost_lines_are_listed_with_reasons_and_neither_judged_nor_taken_for_damage_nor_learnt_from() {
    let recipe = Recipe {
        metres: 1.8,
        frame_lines: FRAME,
        sensor_px: 240,
        rope_width_px: 190.0,
        view_angles_deg: vec![0.0, 90.0],
        ..Recipe::photographic()
    };
    let folder = tempfile::tempdir().unwrap();
    write_acquisition(&Scene::new(&recipe, 11).unwrap(), folder.path(), |_| {}).unwrap();
    let (acquisition, frames) = open_folder(folder.path()).unwrap();
    let losing = Losing { frames: &frames, lost: &LOST };
    let (model, of_losing) = (folder.path().join("rope.model"), folder.path().join("losing.model"));
    let threshold = learn(&acquisition, &frames, &model).threshold;
    let (whole, _) = inspected(&acquisition, &frames, &model);
    let (scores, summary) = inspected(&acquisition, &losing, &model);

    // Nothing is said of lost lines, and no gap looks like damage.
    let is_lost = |view: usize, line: usize| {
        LOST.iter().any(|(lines, loss)| lines.contains(&line) && (view == 0 || matches!(loss, Loss::Black)))
    };
    assert!(scores.keys().all(|&(view, line)| !is_lost(view, line)));
    let highest = |scores: &BTreeMap<(usize, usize), f64>| scores.values().copied().fold(0.0, f64::max);
    assert_eq!(summary.defects, Some(0), "{} and {} without loss", highest(&scores), highest(&whole));
    // All but a mm about the lost lines is judged, the block and what its grain is compared with; but for the little that is left of a
    // stretch of 1968 lines.
    let near = |view: usize, line: usize| {
        (line.saturating_sub(10)..line + 10).any(|line| is_lost(view, line)) || (9840..10_000).contains(&line)
    };
    let left_out: Vec<_> =
        whole.keys().filter(|&&(v, line)| !near(v, line) && !scores.contains_key(&(v, line))).collect();
    assert!(left_out.is_empty(), "{} lines, the first {:?}", left_out.len(), left_out.first());

    // Every gap is told, per view, in metres, with how it came about.
    let told: Vec<(usize, i64, String)> =
        summary.not_covered.iter().map(|n| (n.view, (n.from_m * 1000.0).round() as i64, n.reason.clone())).collect();
    let expected = [
        (0, 250, "3 lines lost: black"),
        (1, 250, "3 lines lost: black"),
        (0, 460, "30 lines lost: repeated"),
        (0, 630, "300 lines lost: saturated"),
        (0, 700, "1 line lost: repeated"),
        (0, 984, "only 160 of 1968 lines are there, which are too few to align"),
        (1, 984, "only 160 of 1968 lines are there, which are too few to align"),
        (0, 1000, "2600 lines lost: black"),
        (1, 1000, "2600 lines lost: black"),
    ];
    assert_eq!(told, expected.map(|(view, mm, reason)| (view, mm, reason.to_owned())));
    let gaps_m: f64 = summary.not_covered.iter().map(|n| n.to_m - n.from_m).sum();
    assert!((summary.covered_view_m + gaps_m - 3.6).abs() < 1e-9 && gaps_m < 0.6, "{gaps_m}");

    // A model that is taught by such a recording judges as one of the whole: its threshold has seen no gap.
    let taught = learn(&acquisition, &losing, &of_losing);
    assert!((taught.threshold - threshold).abs() < 0.25 * threshold, "{} and {threshold}", taught.threshold);
    assert!((taught.learnt_view_m - 3.01).abs() < 0.1, "{}", taught.learnt_view_m);
}
