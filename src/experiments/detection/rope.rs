//! The simulated rope: trained on its intact beginning, then inspected. Frames are rendered as they are asked for, and results
//! lie in temporary folders only until they are judged.

use super::super::ExperimentError;
use super::super::frames::KeptFrames;
use super::super::work::Work;
use super::judged::Judged;
use super::ladder::Rung;
use super::plan::Plan;
use crate::pipeline::model_file::Model;
use crate::pipeline::side_by_side::{Judge, judge_all};
use crate::pipeline::taught::Taught;
use crate::pipeline::train::PASSES;
use crate::pipeline::{Acquisition, Budget, Progress, ProgressReport, TrainingRange};
use crate::simulate::{Recipe, Scene, write};
use tempfile::TempDir;

/// What judging the findings of a rung is worth beside inspecting the rope, in progress.
const JUDGING_SHARE: f64 = 0.01;

/// A rope with defects behind an intact beginning.
pub(super) struct TestRope {
    scene: Scene,
    acquisition: Acquisition,
    train_m: f64,
    skip_lines: usize,
    /// Folder of `rope.json` and `labels.json`.
    description: TempDir,
}

fn temporary() -> Result<TempDir, ExperimentError> {
    tempfile::tempdir().map_err(|source| ExperimentError::Write { path: std::env::temp_dir(), source })
}

/// What rungs make of so many metres, in progress.
pub(super) fn worth_m(rungs: &[Rung], train_m: f64, metres: f64) -> f64 {
    let trainings = 1 + rungs.windows(2).filter(|pair| !taught_alike(&pair[0], &pair[1])).count();
    trainings as f64 * training_m(train_m) + metres * (1.0 + JUDGING_SHARE * rungs.len() as f64)
}

/// A training reads its rope so often.
fn training_m(train_m: f64) -> f64 {
    PASSES.len() as f64 * train_m
}

/// Whether what teaches one teaches the other the same.
fn taught_alike(one: &Rung, other: &Rung) -> bool {
    (one.bandwidths, one.gray_score) == (other.bandwidths, other.gray_score)
}

impl TestRope {
    /// Makes it.
    pub fn new(plan: &Plan) -> Result<Self, ExperimentError> {
        let recipe = Recipe {
            metres: plan.metres,
            defects: plan.defects,
            defect_free_m: plan.train_m,
            view_angles_deg: Recipe::evenly_spaced(plan.views),
            sensor_px: plan.sensor_px,
            rope_width_px: f64::from(plan.sensor_px) * 380.0 / 480.0,
            ..Recipe::photographic()
        };
        let scene = Scene::new(&recipe, plan.seed)?;
        let description = temporary()?;
        write::write_description(&scene, description.path())?;
        let acquisition = write::rope_file(&scene).validate()?;
        let skip_lines = plan.skip_lines(recipe.line_pitch_mm);
        Ok(Self { scene, acquisition, train_m: plan.train_m, skip_lines, description })
    }

    /// Trains every rung on the beginning, inspects all of the rope once for all of them, and judges each on the part that taught nobody.
    pub fn judged(&self, rungs: &[Rung], work: &Work<'_>) -> Result<Vec<Judged>, ExperimentError> {
        let frames = KeptFrames::new(&self.scene, self.skip_lines);
        let models = self.models(rungs, &frames, work)?;
        let folders: Vec<TempDir> = rungs.iter().map(|_| temporary()).collect::<Result<_, _>>()?;
        let judges: Vec<Judge<'_>> = rungs
            .iter()
            .zip(models.iter().zip(&folders))
            .map(|(rung, (model, folder))| Judge { model, judging: rung.judging, results: folder.path() })
            .collect();
        let metres = self.scene.recipe().metres;
        judge_all(&self.acquisition, &frames, &judges, &work.run(metres))?;
        let judged = |folder: TempDir| {
            let run = work.run(JUDGING_SHARE * metres);
            run.report(ProgressReport { stage: "judge", done_m: 0.0, total_m: 1.0 });
            Judged::read(self.description.path(), folder.path(), self.skip_lines)
        };
        folders.into_iter().map(judged).collect()
    }

    /// Models of the rungs, as their files say. Those that the same taught are learnt once.
    fn models(&self, rungs: &[Rung], frames: &KeptFrames<'_>, work: &Work<'_>) -> Result<Vec<Model>, ExperimentError> {
        let to_m = Some(self.train_m);
        let acquisition = &self.acquisition;
        let range = [TrainingRange { name: "the rope", acquisition, source: frames, from_m: None, to_m }];
        let mut models = Vec::new();
        for alike in rungs.chunk_by(taught_alike) {
            let run = work.run_of(training_m(self.train_m), &PASSES);
            let taught = Taught::by(&range, alike[0].bandwidths, alike[0].gray_score, &run)?;
            for rung in alike {
                // Numbers of a file may differ from those in memory in their last digit, and everybody's models come from files.
                let path = self.description.path().join("rung.model");
                taught.model(Budget::default(), &rung.judging)?.write(&path)?;
                models.push(Model::read(&path)?);
            }
        }
        Ok(models)
    }
}

#[cfg(test)]
mod tests {
    use super::super::ladder::{LADDER, OURS};
    use super::*;
    use crate::evaluate::line_scores::read_scores;
    use crate::pipeline::progress::Quiet;
    use crate::pipeline::results::LineScoreFormat;
    use crate::pipeline::{InspectOptions, TrainOptions, inspect, train};

    #[test]
    fn the_last_rung_is_what_everybody_trains_and_inspects_by() {
        let plan = Plan { metres: 3.0, defects: 3, ..Plan::quick(2) };
        let rope = TestRope::new(&plan).unwrap();
        let frames = KeptFrames::new(&rope.scene, usize::MAX);
        let folders = [temporary().unwrap(), temporary().unwrap()];
        let work = Work::new(&Quiet, "test", 1.0);
        let models = rope.models(&[LADDER[0], OURS], &frames, &work).unwrap();
        let judge =
            |n: usize, rung: Rung| Judge { model: &models[n], judging: rung.judging, results: folders[n].path() };
        judge_all(&rope.acquisition, &frames, &[judge(0, LADDER[0]), judge(1, OURS)], &Quiet).unwrap();

        let ordinary = temporary().unwrap();
        let model_path = ordinary.path().join("rope.model");
        let range = TrainingRange {
            name: "the rope",
            acquisition: &rope.acquisition,
            source: &frames,
            from_m: None,
            to_m: Some(plan.train_m),
        };
        train(&[range], TrainOptions::default(), &model_path, &Quiet).unwrap();
        let options = InspectOptions {
            model_path: Some(model_path),
            line_scores: LineScoreFormat::Binary,
            ..InspectOptions::default()
        };
        let summary = inspect(&rope.acquisition, &frames, &options, ordinary.path(), &Quiet).unwrap();
        assert_eq!(summary.threshold, Some(models[1].report.decides_by(None)));
        let read = |folder: &TempDir, name: &str| std::fs::read(folder.path().join(name)).unwrap();
        for name in ["line_scores_view0.f32", "line_scores_view1.f32", "defects.json"] {
            assert!(read(&folders[1], name) == read(&ordinary, name), "{name}");
        }
        // The paper's is another: it has scores, and other ones.
        assert!(read(&folders[0], "line_scores_view0.f32") != read(&ordinary, "line_scores_view0.f32"));
        let scores = read_scores(folders[0].path(), rope.scene.lines(), 2).unwrap().unwrap();
        let scored = scores[0].iter().filter(|score| score.is_finite()).count();
        assert!(scored as f64 > 0.9 * scores[0].len() as f64, "{scored} of {}", scores[0].len());
    }
}
