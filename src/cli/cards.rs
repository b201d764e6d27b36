//! Cards of defects in the results folder: one picture a defect that says why it is one.

use super::recording::Recording;
use super::run_progress::Watcher;
use anyhow::Context;
use ropescope::drawing::captions::Captions;
use ropescope::drawing::why_card::draw;
use ropescope::pipeline::closeup::{CloseupError, closeup};
use ropescope::pipeline::model_file::Model;
use ropescope::pipeline::results::DefectRow;
use ropescope::pipeline::{FrameFiles, FrameSource, Progress, ProgressReport};
use std::path::Path;

/// The stage, as progress names it.
const STAGE: &str = "cards";

/// What cards are drawn from.
pub(crate) struct Cards<'a> {
    pub recording: &'a Recording,
    /// Name of the rope, for the title.
    pub rope: &'a str,
    pub model: &'a Path,
    pub given_contours: Option<&'a [Vec<(f32, f32)>]>,
    /// Line score above which alarms begin.
    pub threshold: Option<f64>,
    pub watcher: &'a Watcher,
}

/// The rope around every defect is aligned anew, over metres that say nothing about how far the cards are.
struct StopOnly<'a>(&'a Watcher);

impl Progress for StopOnly<'_> {
    fn report(&self, _report: ProgressReport) {}

    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

impl Cards<'_> {
    /// Writes `cards/defect_{id}.png` of every defect into the results folder, which holds the likelihood maps. A defect at which the
    /// rope cannot be aligned anew is named and has none.
    pub(crate) fn write(&self, results: &Path, defects: &[DefectRow]) -> anyhow::Result<()> {
        let folder = results.join("cards");
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let model = Model::read(self.model)?;
        for (done, defect) in defects.iter().enumerate() {
            self.watcher.count(STAGE, done, defects.len());
            self.write_one(&model, results, defect)?;
        }
        self.watcher.count(STAGE, defects.len(), defects.len());
        Ok(())
    }

    fn write_one(&self, model: &Model, results: &Path, defect: &DefectRow) -> anyhow::Result<()> {
        let Some(alarm) = defect.worst() else { return Ok(()) };
        let Recording { acquisition, frames, .. } = self.recording;
        let map = |frame: usize| results.join(format!("maps/view{}/frame_{frame:06}.png", alarm.view));
        let maps = FrameFiles::of_maps(acquisition.sensor_px, vec![(0..frames.frames(alarm.view)).map(map).collect()]);
        let stop = StopOnly(self.watcher);
        let seen = match closeup(acquisition, frames, &maps, model, alarm, self.given_contours, &stop) {
            Ok(seen) => seen,
            Err(CloseupError::Pipeline(error)) => return Err(error.into()),
            Err(error @ CloseupError::NotAligned(_)) => {
                self.watcher.remark(&format!("no card of defect {}: {error}", defect.id));
                return Ok(());
            }
        };
        let captions = Captions::of(defect, self.rope, "nobody decided yet", self.threshold);
        let path = results.join(format!("cards/defect_{}.png", defect.id));
        draw(&captions, &seen, alarm).save(&path).with_context(|| format!("cannot write {}", path.display()))
    }
}
