//! One simulated rope through the pipeline, and what came of it beside the truth.

use super::ExperimentError;
use super::frames::SceneFrames;
use crate::evaluate::lay_lengths::{ScoredStretch, each_stretch};
use crate::evaluate::table::Table;
use crate::evaluate::truth::Truth;
use crate::pipeline::tables::write_error;
use crate::pipeline::{FrameSource, InspectOptions, PipelineError, Progress, inspect};
use crate::simulate::{Kind, Scene, truth, write};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// What was measured of a rope.
pub(super) struct Trial {
    /// The fused estimates beside the truth, stretch by stretch.
    pub stretches: Vec<ScoredStretch>,
    /// What is true.
    pub truth: Truth,
    /// Measured column of the rope axis of view 0 less its mean, per line; NaN where there is none.
    pub displacement_px: Vec<f64>,
}

/// Inspects a scene. Edges of the artificial kind are given, as the paper's protocol has it; others are measured.
pub(super) fn run(scene: &Scene, nominal_lay_mm: f64, progress: &dyn Progress) -> Result<Trial, ExperimentError> {
    run_frames(scene, &SceneFrames(scene), nominal_lay_mm, progress)
}

/// The same with other frames than the scene's own. `nominal_lay_mm` is the strand lay that the program is told.
pub(super) fn run_frames(
    scene: &Scene,
    frames: &dyn FrameSource,
    nominal_lay_mm: f64,
    progress: &dyn Progress,
) -> Result<Trial, ExperimentError> {
    let folder = tempfile::tempdir().map_err(|source| write_failed(&std::env::temp_dir(), source))?;
    let mut file = write::rope_file(scene);
    file.strand_lay_mm = Some(nominal_lay_mm);
    let acquisition = file.validate()?;
    let given_contours = (scene.recipe().kind == Kind::Artificial).then(|| {
        let view = |v| truth::contours(scene, v).map(|(low, high)| (low as f32, high as f32)).collect();
        (0..scene.views()).map(view).collect()
    });
    let options = InspectOptions { given_contours, ..InspectOptions::default() };
    inspect(&acquisition, frames, &options, folder.path(), progress)?;
    put(&folder.path().join("truth_lines.csv"), |out| truth::write_lines(scene, out))?;
    put(&folder.path().join("truth_wires.csv"), |out| truth::write_wires(scene, out))?;
    let strands = scene.rope().strands();
    let missing = |name: &str| {
        let path = folder.path().join(name);
        write_error(&path)(std::io::ErrorKind::NotFound.into())
    };
    let truth = Truth::read(folder.path(), strands)?.ok_or_else(|| missing("truth_lines.csv"))?;
    let rows = each_stretch(&truth, strands, acquisition.line_pitch_mm, folder.path())?;
    let stretches: Vec<_> = rows.ok_or_else(|| missing("lay_lengths.csv"))?;
    Ok(Trial {
        stretches: stretches.into_iter().filter(|row| row.view.is_none()).collect(),
        displacement_px: displacement(folder.path(), scene.lines())?,
        truth,
    })
}

fn displacement(folder: &Path, lines: usize) -> Result<Vec<f64>, ExperimentError> {
    let mut table = Table::open_required(&folder.join("displacement.csv"))?;
    let (view, line, value) = (table.column("view")?, table.column("line")?, table.column("displacement_px")?);
    let mut displacement = vec![f64::NAN; lines];
    while table.next_row()? {
        if table.index(view)? == 0
            && let Some(place) = displacement.get_mut(table.index(line)?)
        {
            *place = table.number(value).unwrap_or(f64::NAN);
        }
    }
    Ok(displacement)
}

fn put(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>) -> Result<(), PipelineError> {
    let written = File::create(path).and_then(|file| {
        let mut out = BufWriter::new(file);
        fill(&mut out)?;
        out.flush()
    });
    written.map_err(write_error(path))
}

fn write_failed(path: &Path, source: std::io::Error) -> ExperimentError {
    ExperimentError::Write { path: path.into(), source }
}

impl Trial {
    /// |error| of the strand lays in mm.
    pub fn strand_errors_mm(&self) -> impl Iterator<Item = f64> {
        self.stretches.iter().filter_map(|s| Some(s.strand?.error_mm()))
    }

    /// Errors of the wire lays of all strands in mm.
    pub fn wire_errors_mm(&self) -> impl Iterator<Item = f64> {
        self.stretches.iter().flat_map(|s| s.wires.iter().flatten().map(|w| w.error_mm()))
    }

    /// Estimates that are absent: of strands, and of wires.
    pub fn absent(&self) -> (usize, usize) {
        let strands = self.stretches.iter().filter(|s| s.strand.is_none()).count();
        (strands, self.stretches.iter().map(|s| s.wires.iter().filter(|w| w.is_none()).count()).sum())
    }
}
