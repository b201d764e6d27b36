//! A defect close up: what a view saw, what the model would draw there, and gray values along the wire and across the wires, observed
//! and expected. Aligns the neighbourhood of the defect anew, because inspections do not keep the course of every line.

use super::drive::Drive;
use super::model_file::Model;
use super::profile::{Mean, ProfilePoint, UsualGrays};
use super::results::AlarmRow;
use super::stretches::{STRETCH_LINES, StretchReader};
use super::{Acquisition, FrameSource, PipelineError, Progress};
use crate::vision::aligner::AlignedStretch;
use crate::vision::camera::Camera;
use crate::vision::image::GrayImage;
use crate::vision::inspection_model::AlignedView;
use crate::vision::render::{Renderer, Texture};
use crate::vision::surface_map::SurfacePoint;
use std::cmp::Reverse;
use std::ops::Range;

/// Stretches that are aligned, and how many of them lie before the one with the defect if there are so many: alignment searches
/// over five before it tracks.
const STRETCHES: usize = 7;
const BEFORE: usize = 4;
/// Rope beside the defect, in lengths of it and in diameters, whichever is more.
const CONTEXT: (f64, f64) = (0.3, 0.5);
/// Lines, to either side, over which the peak has to differ from intact rope.
const PEAK_LINES: usize = 5;
/// Lines, to either side, over which the profile across the wires is averaged.
const ACROSS_LINES: usize = 3;
/// How far a pixel may be from the course through the peak to count in the profile along it, in wire steps.
const ALONG_STEPS: f32 = 0.15;
/// Why there is no close-up.
#[derive(Debug, thiserror::Error)]
pub enum CloseupError {
    /// The run ended without a result.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The rope could not be aligned there.
    #[error("the rope cannot be aligned at the defect: {0}")]
    NotAligned(String),
}

/// A defect close up in one view. Images show the same lines and columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Closeup {
    /// The lines shown.
    pub lines: Range<usize>,
    /// The columns shown: the rope with a little beside it.
    pub columns: Range<usize>,
    /// Line and column with the least likelihood within the alarm.
    pub peak: (usize, usize),
    /// Column of the rope axis at the peak.
    pub axis_px: f64,
    /// Rope per line in mm.
    pub pitch_mm: f64,
    /// Columns per mm of rope.
    pub px_per_mm: f64,
    /// What the view saw.
    pub observed: GrayImage,
    /// Its likelihood map; 255 was not judged.
    pub likelihood: GrayImage,
    /// Intact rope there, as the model draws it.
    pub intact: GrayImage,
    /// Gray along the wire through the peak.
    pub along: Vec<ProfilePoint>,
    /// Gray across the wires at the peak.
    pub across: Vec<ProfilePoint>,
}

/// Looks at an alarm in its view. `map` gives the likelihood maps of that view, as its only one; `given_contours` are those that the
/// inspection used, if it did not measure them.
pub fn closeup(
    acquisition: &Acquisition,
    source: &dyn FrameSource,
    map: &dyn FrameSource,
    model: &Model,
    alarm: &AlarmRow,
    given_contours: Option<&[Vec<(f32, f32)>]>,
    progress: &dyn Progress,
) -> Result<Closeup, CloseupError> {
    model.check(acquisition)?;
    let stretch_lines = acquisition.aligner_spec().stretch_lines(STRETCH_LINES);
    let middle = usize::midpoint(alarm.first_line, alarm.last_line);
    // The defect lies in the middle of a stretch, so that there is rope on both sides.
    let start = middle.saturating_sub(stretch_lines / 2);
    let from = start - stretch_lines * BEFORE.min(start / stretch_lines);
    let range = from..from + STRETCHES * stretch_lines;
    let drive = Drive { acquisition, source, range, given_contours, stage: "align", progress };
    let mut found: Option<(AlignedStretch, Vec<Camera>)> = None;
    drive.run(&mut drive.reader()?, |stretch, cameras| {
        if (stretch.first_line..stretch.first_line + stretch.lines).contains(&middle) {
            found = Some((stretch, cameras.to_vec()));
        }
        Ok(())
    })?;
    let (stretch, cameras) =
        found.ok_or_else(|| CloseupError::NotAligned(format!("the acquisition has no line {middle}")))?;
    let estimates = stretch.estimates.as_ref().map_err(|reason| CloseupError::NotAligned(reason.to_string()))?;
    let view = &stretch.views[alarm.view];
    if !view.usable() {
        return Err(CloseupError::NotAligned("this view does not show both edges of the rope here".into()));
    }
    let pitch_mm = acquisition.line_pitch_mm;
    let camera = &cameras[alarm.view];
    let block_lines = crate::vision::evidence::block_lines(pitch_mm);
    let seen = AlignedView { rope: &acquisition.rope, camera, estimates, view, block_lines, pitch_mm };
    let lines = lines_shown(acquisition, alarm, &stretch);
    let columns = columns_shown(&seen, &lines, stretch.first_line);
    let sensor_px = acquisition.sensor_px as usize;
    let all_lines = stretch.first_line..stretch.first_line + stretch.lines;
    let likelihood = StretchReader::new(map, sensor_px, stretch.lines, all_lines, None)
        .and_then(|mut reader| reader.next_stretch())
        .map_err(PipelineError::from)?
        .and_then(|mut maps| maps.images.pop())
        .unwrap_or_default();
    let place = Place { seen, first_line: stretch.first_line, lines, columns };
    let appearance = &model.views[alarm.view].gray;
    let light = place.light();
    let mut surface = place.seen.surface_map();
    let intact = Renderer::new(appearance).render(&mut surface, &view.axis_px, sensor_px, light, Texture::Expected);
    let usual = UsualGrays { appearance, light };
    let peak = place.peak(&likelihood, &intact, alarm);
    Ok(Closeup {
        peak,
        axis_px: place.axis_px(peak.0),
        pitch_mm,
        px_per_mm: camera.px_per_mm,
        observed: place.crop(&view.image),
        likelihood: place.crop(&likelihood),
        intact: place.crop(&intact),
        along: place.along(&usual, peak),
        across: place.across(&usual, peak),
        lines: place.lines,
        columns: place.columns,
    })
}

/// The lines of a close-up: the alarm with some rope beside it, within its stretch.
fn lines_shown(acquisition: &Acquisition, alarm: &AlarmRow, stretch: &AlignedStretch) -> Range<usize> {
    let length = alarm.last_line - alarm.first_line + 1;
    let diameter_lines = acquisition.rope.diameter_mm() / acquisition.line_pitch_mm;
    let context = (CONTEXT.0 * length as f64).max(CONTEXT.1 * diameter_lines) as usize;
    let end = stretch.first_line + stretch.lines;
    alarm.first_line.saturating_sub(context).max(stretch.first_line)..(alarm.last_line + 1 + context).min(end)
}

fn columns_shown(seen: &AlignedView<'_>, lines: &Range<usize>, first_line: usize) -> Range<usize> {
    let half_px = (seen.camera.px_per_mm * seen.rope.diameter_mm() * 0.54) as f32;
    let axes = &seen.view.axis_px[lines.start - first_line..lines.end - first_line];
    let (low, high) = axes.iter().fold((f32::MAX, f32::MIN), |(low, high), a| (low.min(*a), high.max(*a)));
    let from = ((low - half_px).max(0.0) as usize).min(seen.view.image.width() - 1);
    from..((high + half_px).max(0.0) as usize).clamp(from + 1, seen.view.image.width())
}

/// Part of an aligned view.
struct Place<'a> {
    seen: AlignedView<'a>,
    first_line: usize,
    lines: Range<usize>,
    columns: Range<usize>,
}

impl Place<'_> {
    fn crop(&self, image: &GrayImage) -> GrayImage {
        let lines = self.lines.start - self.first_line..(self.lines.end - self.first_line).min(image.lines());
        let pixels = lines.flat_map(|line| &image.line(line)[self.columns.clone()]).copied().collect();
        GrayImage::new(self.columns.len(), pixels).unwrap_or_default()
    }

    fn axis_px(&self, line: usize) -> f64 {
        f64::from(self.seen.view.axis_px[line - self.first_line])
    }

    /// The darkest pixel of the likelihood map within the alarm; of many, as black has an end, the one that differs most from intact
    /// rope, over some lines so that it is no speck.
    fn peak(&self, likelihood: &GrayImage, intact: &GrayImage, alarm: &AlarmRow) -> (usize, usize) {
        let end = self.lines.end.min(self.first_line + likelihood.lines());
        let lines = alarm.first_line.max(self.lines.start)..(alarm.last_line + 1).min(end);
        let columns = alarm.first_column..(alarm.last_column + 1).min(likelihood.width());
        let observed = &self.seen.view.image;
        let difference = |line: usize, column: usize| {
            let around = line.saturating_sub(PEAK_LINES)..(line + PEAK_LINES + 1).min(observed.lines());
            let at = |line: usize| i32::from(observed.line(line)[column]) - i32::from(intact.line(line)[column]);
            around.map(at).sum::<i32>().abs()
        };
        lines
            .map(|line| line - self.first_line)
            .flat_map(|line| columns.clone().map(move |column| (line, column)))
            .min_by_key(|&(line, column)| (likelihood.line(line)[column], Reverse(difference(line, column))))
            .map_or(
                (
                    usize::midpoint(alarm.first_line, alarm.last_line),
                    usize::midpoint(alarm.first_column, alarm.last_column),
                ),
                |(line, column)| (self.first_line + line, column),
            )
    }

    /// Mean gray of the rope, as the model's gray scale measures light.
    fn light(&self) -> f32 {
        let image = &self.seen.view.image;
        let half_px = (0.35 * self.seen.camera.px_per_mm * self.seen.rope.diameter_mm()) as f32;
        let (mut sum, mut n) = (0.0, 0.0);
        for line in self.lines.clone().map(|line| line - self.first_line) {
            let axis = self.seen.view.axis_px[line];
            let from = ((axis - half_px).max(0.0) as usize).min(image.width());
            let to = ((axis + half_px).max(0.0) as usize).clamp(from, image.width());
            sum += image.line(line)[from..to].iter().map(|&g| f64::from(g)).sum::<f64>();
            n += (to - from) as f64;
        }
        (sum / f64::max(n, 1.0)) as f32
    }

    fn points(&self, line: usize, each: impl FnMut(SurfacePoint)) {
        self.seen.surface_map().for_each(line, self.seen.view.axis_px[line], each);
    }

    fn along(&self, usual: &UsualGrays<'_>, peak: (usize, usize)) -> Vec<ProfilePoint> {
        let mut course = None;
        self.points(peak.0 - self.first_line, |p| {
            if course.is_none_or(|c: SurfacePoint| p.column.abs_diff(peak.1) < c.column.abs_diff(peak.1)) {
                course = Some(p);
            }
        });
        let Some(course) = course else { return Vec::new() };
        let wires = self.seen.rope.wires() as f32;
        let mut surface = self.seen.surface_map();
        let mut profile = Vec::new();
        for line in self.lines.clone() {
            let row = self.seen.view.image.line(line - self.first_line);
            let mut mean = Mean::default();
            surface.for_each(line - self.first_line, self.seen.view.axis_px[line - self.first_line], |p| {
                let apart = (p.wire_place - course.wire_place).rem_euclid(wires);
                if p.strand == course.strand && apart.min(wires - apart) <= ALONG_STEPS {
                    mean.add(row[p.column], usual.of(p.cell));
                }
            });
            profile.extend(mean.point((line as f64 - peak.0 as f64) * self.seen.pitch_mm));
        }
        profile
    }

    fn across(&self, usual: &UsualGrays<'_>, peak: (usize, usize)) -> Vec<ProfilePoint> {
        let mut means = vec![Mean::default(); self.columns.len()];
        let from = peak.0.saturating_sub(ACROSS_LINES).max(self.lines.start);
        for line in from..(peak.0 + ACROSS_LINES + 1).min(self.lines.end) {
            let row = self.seen.view.image.line(line - self.first_line);
            self.points(line - self.first_line, |p| {
                if self.columns.contains(&p.column) {
                    means[p.column - self.columns.start].add(row[p.column], usual.of(p.cell));
                }
            });
        }
        let axis = self.axis_px(peak.0);
        let at_mm = |k: usize| ((self.columns.start + k) as f64 - axis) / self.seen.camera.px_per_mm;
        means.iter().enumerate().filter_map(|(k, mean)| mean.point(at_mm(k))).collect()
    }
}
