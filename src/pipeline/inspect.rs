//! Aligns, measures and, with a model, finds defects; writes the results folder.

use super::blind_columns::BlindColumns;
use super::coverage::Coverage;
use super::detection::{Detection, Judged};
use super::diameters::{DiameterExtremes, DiameterSummary};
use super::drive::Drive;
use super::fit::ModelFit;
use super::found::Found;
use super::lay_length_table::{LayLengthTable, lay_length_rows};
use super::maps::MapWriter;
use super::model_file::Model;
use super::results::{LineScoreFormat, Summary, Threshold};
use super::tables::{LineValues, write_error};
use super::{Acquisition, FrameSource, PipelineError, Progress};
use crate::vision::aligner::AlignedStretch;
use crate::vision::judging::Judging;
use std::path::{Path, PathBuf};

/// How to inspect.
#[derive(Debug, Clone, Default)]
pub struct InspectOptions {
    /// Model file; without one, only alignment is done.
    pub model_path: Option<PathBuf>,
    /// Write likelihood maps as `maps/view{v}/frame_{n:06}.png`.
    pub maps: bool,
    /// Line score above which a line is an alarm, with who says so; `None`: the model's own. Without a second level, it lies as far
    /// under the first as the model's own.
    pub threshold: Option<Threshold>,
    /// How to store line scores.
    pub line_scores: LineScoreFormat,
    /// Contours measured elsewhere, `contours[view]`: (lower, upper) per line in px; used instead of extraction.
    pub given_contours: Option<Vec<Vec<(f32, f32)>>>,
}

/// Inspects `source` and writes `lay_lengths.csv`, `displacement.csv`, line scores, `defects.json`, `summary.json` and, on
/// request, `maps/` into `results_folder` (made if absent; `summary.json` is written last, so a folder without it is not whole).
pub fn inspect(
    acquisition: &Acquisition,
    source: &dyn FrameSource,
    options: &InspectOptions,
    results_folder: &Path,
    progress: &dyn Progress,
) -> Result<Summary, PipelineError> {
    let started = std::time::Instant::now();
    let model = options.model_path.as_deref().map(Model::read).transpose()?;
    if let Some(model) = &model {
        model.check(acquisition)?;
    }
    std::fs::create_dir_all(results_folder).map_err(write_error(results_folder))?;
    remove_old(&results_folder.join("summary.json"))?;
    let drive = Drive {
        acquisition,
        source,
        range: 0..usize::MAX,
        given_contours: options.given_contours.as_deref(),
        stage: "inspect",
        progress,
    };
    let mut reader = drive.reader()?;
    let views = acquisition.view_angles_rad.len();
    let mut lay_lengths = LayLengthTable::create(results_folder.join("lay_lengths.csv"), acquisition.rope.strands())?;
    let mut displacement = LineValues::create(results_folder, views)?;
    let threshold = model.as_ref().map(|m| m.report.decides_by(options.threshold.as_ref()));
    let mut detection = match (&model, &threshold) {
        (Some(model), Some(threshold)) => {
            let judged_by = (model, Judging::WHOLE);
            Some(Detection::new(acquisition, judged_by, threshold, LineValues::create(results_folder, views)?))
        }
        _ => None,
    };
    let mut maps = match (&model, options.maps) {
        (Some(_), true) => Some(MapWriter::new(results_folder.join("maps"), acquisition.sensor_px as usize, source)),
        _ => None,
    };
    let mut coverage = Coverage::new(views);
    let mut blind = BlindColumns::new(views);
    let mut extremes = DiameterExtremes::default();
    // Who looks on hears of lay lengths at once: the search settles several stretches together, and scoring them takes a while.
    let tell = |settled: &[AlignedStretch]| {
        let rows: Vec<_> = settled.iter().flat_map(|stretch| lay_length_rows(acquisition, stretch)).collect();
        for row in &rows {
            lay_lengths.write(row)?;
            extremes.add(row);
        }
        progress.found(Found { lay_lengths: rows, defects: None });
        Ok(())
    };
    let mut judged = |detection: &mut Detection<'_>, judged: Option<Judged>| -> Result<(), PipelineError> {
        let Some(Judged { end_line, maps: drawn }) = judged else { return Ok(()) };
        if let Some(maps) = &mut maps {
            maps.append(drawn)?;
        }
        progress.found(Found { lay_lengths: Vec::new(), defects: Some(detection.so_far(end_line)) });
        Ok(())
    };
    drive.run_telling(&mut reader, tell, |stretch, cameras| {
        for (v, view) in stretch.views.iter().enumerate() {
            let aligned = stretch.estimates.is_ok() && view.usable();
            let known = |k: usize| aligned && !view.lost.contains(k);
            displacement.append(v, (0..stretch.lines).map(|k| if known(k) { view.axis_px[k] } else { f32::NAN }))?;
        }
        coverage.add(&stretch, acquisition.line_pitch_mm);
        if let Some(detection) = &mut detection {
            blind.add(&stretch);
            let before = detection.take(stretch.into(), cameras, options.maps)?;
            judged(detection, before)?;
        }
        Ok(())
    })?;
    if let Some(detection) = &mut detection {
        let last = detection.take_last(options.maps)?;
        judged(detection, last)?;
    }
    let total_m = reader.lines() as f64 * acquisition.line_pitch_mm / 1000.0;
    lay_lengths.finish()?;
    if let Some(maps) = maps {
        maps.finish()?;
    }
    let (found, line_scores) = detection.map(Detection::finish).unzip();
    // The two long tables.
    let (one, other) = rayon::join(
        || displacement.write_csv("displacement.csv", "view,line,displacement_px", true, 3),
        || match (line_scores, options.line_scores) {
            (Some(scores), LineScoreFormat::Csv) => scores.write_csv("line_scores.csv", "view,line,score", false, 4),
            (Some(scores), LineScoreFormat::Binary) => scores.write_binary("line_scores"),
            (None, _) => Ok(()),
        },
    );
    one.and(other)?;
    let (mut defects, mut look_again, mut fit) = (None, None, None);
    if let Some(found) = found {
        write_json(&results_folder.join("defects.json"), &found.defects)?;
        if let Some(again) = &found.look_again {
            write_json(&results_folder.join("look_again.json"), again)?;
            look_again = Some(again.len());
        }
        defects = Some(found.defects.len());
        fit = found.fit;
    }
    let seconds = (started.elapsed() - reader.waited()).as_secs_f64();
    let diameter = extremes.summary(acquisition);
    let (covered_view_m, not_covered) = coverage.finish(acquisition);
    let summary = Summary {
        ropescope_version: env!("CARGO_PKG_VERSION").into(),
        model: options
            .model_path
            .as_ref()
            .map(|p| p.file_name().unwrap_or(p.as_os_str()).to_string_lossy().into_owned()),
        construction: acquisition.construction(),
        lines: reader.lines(),
        metres: total_m,
        covered_view_m,
        not_covered,
        threshold,
        defects,
        look_again,
        seconds,
        metres_per_second: total_m / seconds.max(1e-9),
        notes: fit
            .iter()
            .filter_map(ModelFit::warning)
            .chain(blind.notes(acquisition))
            .chain(diameter.as_ref().and_then(DiameterSummary::note))
            .collect(),
        diameter,
        fit,
    };
    write_json(&results_folder.join("summary.json"), &summary)?;
    Ok(summary)
}

fn remove_old(path: &Path) -> Result<(), PipelineError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(write_error(path)(e)),
        _ => Ok(()),
    }
}

pub(super) fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), PipelineError> {
    let text = serde_json::to_string_pretty(value).map_err(|e| write_error(path)(e.into()))?;
    std::fs::write(path, text).map_err(write_error(path))
}
