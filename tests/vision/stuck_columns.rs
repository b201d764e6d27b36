//! A sensor with columns that say nothing: the inspection tells that they are not judged.

use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::progress::Quiet;
use ropescope::pipeline::source::{Frame, SourceError};
use ropescope::pipeline::{FrameFiles, FrameSource, InspectOptions, TrainOptions, TrainingRange, inspect, train};
use ropescope::simulate::{Recipe, Scene, write_acquisition};

/// Columns that are dark all the time; with two on either side of them, seven are not judged.
const STUCK: [usize; 2] = [100, 102];

/// Frames of a sensor on which these columns broke.
struct Stuck<'a>(&'a FrameFiles);

impl FrameSource for Stuck<'_> {
    fn views(&self) -> usize {
        self.0.views()
    }

    fn frames(&self, view: usize) -> usize {
        self.0.frames(view)
    }

    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
        self.0.lines(view, frame)
    }

    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
        let mut loaded = self.0.load(view, frame)?;
        for row in loaded.pixels.chunks_exact_mut(loaded.width) {
            STUCK.iter().for_each(|&column| row[column] = 0);
        }
        Ok(loaded)
    }
}

#[test]
fn an_inspection_tells_how_much_of_the_width_is_not_judged() {
    let recipe = Recipe {
        metres: 1.2,
        sensor_px: 240,
        rope_width_px: 190.0,
        view_angles_deg: vec![30.0],
        ..Recipe::photographic()
    };
    let folder = tempfile::tempdir().unwrap();
    write_acquisition(&Scene::new(&recipe, 14).unwrap(), folder.path(), |_| {}).unwrap();
    let (acquisition, frames) = open_folder(folder.path()).unwrap();
    let model = folder.path().join("rope.model");
    let range = TrainingRange { name: "rope", acquisition: &acquisition, source: &frames, from_m: None, to_m: None };
    train(&[range], TrainOptions::default(), &model, &Quiet).unwrap();
    let told = |source: &dyn FrameSource| -> Vec<String> {
        let results = tempfile::tempdir().unwrap();
        let options = InspectOptions { model_path: Some(model.clone()), ..InspectOptions::default() };
        let notes = inspect(&acquisition, source, &options, results.path(), &Quiet).unwrap().notes;
        notes.into_iter().filter(|note| note.contains("columns")).collect()
    };
    assert_eq!(told(&frames), Vec::<String>::new());
    let notes = told(&Stuck(&frames));
    assert!(notes.len() == 1 && notes[0].starts_with("view 0: up to 7 of the "), "{notes:?}");
    assert!(notes[0].contains("between metre 0.00 and 1.") && notes[0].contains("clean or replace"), "{notes:?}");
}
