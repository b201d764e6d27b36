//! The simulated rope: trained on its intact beginning, then inspected. Frames are rendered as they are asked for, and results
//! lie in a temporary folder only until they are judged.

use super::super::ExperimentError;
use super::super::frames::SceneFrames;
use super::super::work::Work;
use super::judged::Judged;
use super::plan::Plan;
use crate::pipeline::model_file::Model;
use crate::pipeline::train::PASSES;
use crate::pipeline::{Acquisition, InspectOptions, TrainOptions, TrainingRange, inspect, train};
use crate::simulate::{Recipe, Scene, write};
use std::path::Path;
use tempfile::TempDir;

/// A rope and a model of it.
pub(super) struct Trained {
    pub model: Model,
    scene: Scene,
    acquisition: Acquisition,
    skip_lines: usize,
    folder: TempDir,
}

fn temporary() -> Result<TempDir, ExperimentError> {
    tempfile::tempdir().map_err(|source| ExperimentError::Write { path: std::env::temp_dir(), source })
}

impl Trained {
    /// Makes the rope and trains on its beginning.
    pub fn new(plan: &Plan, work: &Work<'_>) -> Result<Self, ExperimentError> {
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
        let folder = temporary()?;
        write::write_description(&scene, folder.path())?;
        let acquisition = write::rope_file(&scene).validate()?;
        let path = folder.path().join("rope.model");
        let run = work.run_of(PASSES.len() as f64 * plan.train_m, &PASSES);
        let source = &SceneFrames(&scene);
        let to_m = Some(plan.train_m);
        let range = TrainingRange { name: "the rope", acquisition: &acquisition, source, from_m: None, to_m };
        train(&[range], TrainOptions::default(), &path, &run)?;
        drop(run);
        let skip_lines = plan.skip_lines(recipe.line_pitch_mm);
        Ok(Self { model: Model::read(&path)?, scene, acquisition, skip_lines, folder })
    }

    /// Inspects all of the rope with a model and judges the part that was not trained on.
    pub fn inspect(&self, model: &Model, work: &Work<'_>) -> Result<Judged, ExperimentError> {
        let results = temporary()?;
        let model_path = self.folder.path().join("inspected.model");
        model.write(&model_path)?;
        let options = InspectOptions { model_path: Some(model_path), ..InspectOptions::default() };
        let run = work.run(self.scene.recipe().metres);
        inspect(&self.acquisition, &SceneFrames(&self.scene), &options, results.path(), &run)?;
        Judged::read(self.description(), results.path(), self.skip_lines)
    }

    /// Folder of `rope.json` and `labels.json`.
    fn description(&self) -> &Path {
        self.folder.path()
    }
}
