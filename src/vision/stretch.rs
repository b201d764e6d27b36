//! A stretch of rope as all views show it, and what is measured of its strands. [Wacker13, sec. 3.3.1, extended]
//!
//! Contours give the mean course of the strands (eq. 13); registration with the template gives each strand's own deviation.

use super::camera::Camera;
use super::contour::Contours;
use super::displacement::axis_readings;
use super::image::GrayImage;
use super::lost_lines::LostLines;
use super::model_contour::ModelContour;
use super::outline_detail::OutlineDetail;
use super::reference::Reference;
use super::registration::{KnotSums, Knots, register, register_contours};
use super::rope::Rope;
use super::smoothing::Measurement;
use super::strand_alignment::ContourView;
use super::surface::Outlines;
use super::sway::{AxisGrid, AxisKnots};
use super::template::Template;
use super::wire_pattern::WirePattern;
use std::f64::consts::TAU;
use std::ops::Range;

/// Neighbouring pixels and lines share wires: so many registered pixels count as one independent one. Refined from residuals.
const PIXELS_PER_INDEPENDENT: f64 = 250.0;
/// The same in Lang lay, or before the wires are known. There wires run much as the valleys between the strands do, and pass a
/// place in step with the strands: what is left of them in the template moves with it, which residuals cannot show. So
/// the contours must lead.
const PIXELS_PER_INDEPENDENT_LANG: f64 = 750.0;

/// Farthest that a strand is moved by one Gauss-Newton step, which is only good for small corrections: larger ones take several.
pub const FARTHEST_STEP_RAD: f64 = 0.06;
/// Share of the lines that were not lost that must show both edges.
const LEAST_FOUND: f64 = 0.4;
/// Share of the lines of a stretch that must not be lost. Measured with two views of 240 px: beside a gap of 3000 lines in both, 48 % of a
/// stretch are judged as usual, 39 % were laid so badly that they looked like damage.
const LEAST_SEEN: f64 = 0.45;

/// One view of a stretch.
#[derive(Debug, Clone, Default)]
pub struct ViewStretch {
    /// The lines; without lines the view was lost here. Those that were lost are black: nothing is measured in a black line.
    pub image: GrayImage,
    /// Which lines were lost.
    pub lost: LostLines,
    /// Columns that are not judged, in order: the sensor says nothing there, and the image was drawn from what is beside them.
    pub blind: Vec<Range<usize>>,
    /// Its contours; NaN where there are none.
    pub contours: Contours,
    /// The contours without what wires add to the outline, as far as this is known.
    pub outline: Contours,
    /// Contours of the lines before and after the stretch, as far as they are known: the axis goes on there.
    pub beyond: [Contours; 2],
    /// What the contours say of the axis.
    pub axis_knots: AxisKnots,
    /// Scatter of the contours of single lines about the axis.
    pub axis_roughness_px: f64,
    /// Column of the rope axis at every line.
    pub axis_px: Vec<f32>,
}

/// What the strands of a stretch were measured to be, at its knots.
#[derive(Debug, Clone, Default)]
pub struct StrandKnots {
    /// `views[v][knot * strands + j]`: strand phases in rad, unwrapped, as view v saw them.
    pub views: Vec<Vec<Measurement>>,
}

/// Everything that stays the same for one view over an acquisition.
#[derive(Debug, Clone)]
pub struct ViewModel {
    /// The camera.
    pub camera: Camera,
    /// The outline of the model rope in it.
    pub contour: ModelContour,
    /// Where its strands begin and end.
    pub outlines: Outlines,
    /// Mean look of the strands; absent until learnt.
    pub template: Option<Template>,
    /// What wires add to it; absent until they are tracked.
    pub pattern: Option<WirePattern>,
    /// What the real outline has beside the model's; absent until the wires are tracked.
    pub detail: Option<OutlineDetail>,
    /// Factor on the registration's variance, found from residuals.
    pub noise_scale: f64,
    /// Factor on the contours' variance, raised where the picture contradicts them.
    pub contour_noise_scale: f64,
}

impl ViewStretch {
    /// The contours with their model, for the alignment of the strands.
    pub fn contour_view<'a>(&'a self, model: &'a ViewModel) -> ContourView<'a> {
        ContourView { contours: &self.contours, model: &model.contour, angle_rad: model.camera.angle_rad }
    }

    /// Sets the axis from the contours (eq. 10), as smooth as ropes sway.
    pub fn set_axis(&mut self, model: &ViewModel, rope: &Rope, reference: &Reference) {
        self.outline = match &model.detail {
            Some(detail) => detail.taken_out(rope, model.camera.angle_rad, &self.contours, |line, strands, wires| {
                reference.phases_rad(rope, line, strands);
                reference.wires_rad(line, wires);
            }),
            None => self.contours.clone(),
        };
        let period_mm = TAU / reference.rate_rad_per_mm.abs() / rope.strands() as f64;
        let period_lines = (period_mm / reference.pitch_mm).round().max(8.0) as usize;
        let [before, after] = &self.beyond;
        let first = before.len() as f64;
        let readings = axis_readings(
            &Contours::joined([before, &self.outline, after]),
            |k| {
                let phase = model.camera.phase_in_view(reference.mean_phase_rad(k as f64 - first));
                model.contour.edges_px(phase)
            },
            period_lines,
        );
        let (knot_lines, pitch_mm) = (reference.knot_lines, reference.pitch_mm);
        let grid = AxisGrid { knot_lines, pitch_mm, period_lines, diameter_mm: rope.diameter_mm() };
        self.axis_knots = AxisKnots::new(&readings, before.len(), grid);
        self.axis_px = self.axis_knots.by_contours(self.outline.len());
        self.axis_roughness_px = scatter_px(&readings.axis_px[before.len()..], &self.axis_px);
    }

    /// Sets it from contours and image: `sums` are those of this view, registered with the axis as it is.
    pub fn refine_axis(&mut self, sums: &[KnotSums]) {
        let image_px: Vec<f64> = sums.iter().map(KnotSums::sideways_px).collect();
        if let Some(axis_px) = self.axis_knots.with_image(&image_px, &self.axis_px) {
            self.axis_px = axis_px;
        }
    }

    /// Number of lines that were not lost.
    pub fn lines_seen(&self) -> usize {
        self.image.lines() - self.lost.len()
    }

    /// True if so many lines were lost that the others do not measure the stretch.
    pub fn lost_too_many(&self) -> bool {
        (self.lines_seen() as f64) < LEAST_SEEN * self.image.lines() as f64
    }

    /// True if so many of the lines show both edges that the stretch can be measured.
    pub fn shows_edges(&self) -> bool {
        let (lines, seen) = (self.image.lines() as f64, self.lines_seen() as f64);
        lines > 0.0 && !self.lost_too_many() && self.contours.found() * lines >= LEAST_FOUND * seen
    }

    /// True if the view shows the rope here.
    pub fn usable(&self) -> bool {
        self.image.lines() > 0 && self.axis_px.first().is_some_and(|a| a.is_finite())
    }
}

fn scatter_px(values: &[f32], course: &[f32]) -> f64 {
    let off = values.iter().zip(course).map(|(value, course)| f64::from(value - course)).filter(|off| off.is_finite());
    let (squares, count) = off.fold((0.0, 0.0), |(squares, count), off| (squares + off * off, count + 1.0));
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Registers every view with its template: normal equations per view and knot (empty for unusable views). One of `thinned` of
/// the usual lines is looked at.
pub fn register_views(
    rope: &Rope,
    models: &[ViewModel],
    views: &[ViewStretch],
    reference: &Reference,
    thinned: usize,
) -> Vec<Vec<KnotSums>> {
    use rayon::prelude::*;
    models
        .par_iter()
        .zip(views)
        .map(|(model, view)| {
            if !view.usable() {
                return Vec::new();
            }
            let angle = model.camera.angle_rad;
            let phases = |line: usize, out: &mut [f64]| reference.phases_rad(rope, line, out);
            let wires = |line: usize, out: &mut [f64]| reference.apparent_wires_rad(rope, angle, line, out);
            let (pattern, knots) = (model.pattern.as_ref(), Knots { lines: reference.knot_lines, thinned });
            let mut sums = match &model.template {
                Some(template) => {
                    register(rope, template, pattern, angle, &view.image, &view.axis_px, knots, phases, wires)
                }
                None => vec![KnotSums::default(); reference.knots()], // contours alone, until the template is learnt
            };
            register_contours(rope, &model.contour, angle, &view.outline, &view.axis_px, knots, phases, &mut sums);
            sums
        })
        .collect()
}

/// Turns normal equations into measured phases.
pub fn strand_knots(rope: &Rope, models: &[ViewModel], sums: &[Vec<KnotSums>], reference: &Reference) -> StrandKnots {
    let (pixels_per_independent, most_shared) = if reference.is_ordinary() {
        (PIXELS_PER_INDEPENDENT, MOST_SHARED)
    } else {
        (PIXELS_PER_INDEPENDENT_LANG, MOST_SHARED_LANG)
    };
    let n = rope.strands();
    let views = sums
        .iter()
        .enumerate()
        .map(|(v, knots)| {
            let (squares, pixels) = knots.iter().fold((0.0, 0.0), |(s, p), k| (s + k.squares, p + k.pixels));
            let variance = (squares / pixels.max(1.0)).max(1e-6) * pixels_per_independent * models[v].noise_scale;
            let contour_variance = contour_variance_px2(knots, most_shared) * models[v].contour_noise_scale;
            let mut measured = vec![Measurement::default(); reference.knots() * n];
            for (k, knot) in knots.iter().enumerate() {
                let mean = reference.mean_phase_rad(reference.knot_middle(k));
                for j in 0..n {
                    let wire = WireError::near(knots, k, j);
                    let information = wire.left(knot, j) / variance + knot.contour_phase_phase[j] / contour_variance;
                    if information <= 0.0 {
                        continue;
                    }
                    let image = (knot.phase_difference[j] - knot.phase_wire[j] * wire.error_rad) / variance;
                    let step = (image + knot.contour_phase_difference[j] / contour_variance) / information;
                    let base = mean + j as f64 * rope.strand_step_rad() + reference.deviation_rad[k * n + j];
                    let step = step.clamp(-FARTHEST_STEP_RAD, FARTHEST_STEP_RAD);
                    measured[k * n + j] = Measurement { value_rad: base + step, information };
                }
            }
            measured
        })
        .collect();
    StrandKnots { views }
}

/// Knots to either side over which the wires are taken to be equally far from where they were expected.
const WIRE_ERROR_KNOTS: usize = 3;

/// How far the wires of a strand are from where they were expected, near one knot. Wires that are not where they were taken out
/// look like a moved strand; so their error is solved for with the strand's.
struct WireError {
    error_rad: f64,
    /// Share of the strand's information that the wires' error could feign.
    feigned: f64,
}

impl WireError {
    fn near(knots: &[KnotSums], k: usize, j: usize) -> Self {
        let near = &knots[k.saturating_sub(WIRE_ERROR_KNOTS)..(k + WIRE_ERROR_KNOTS + 1).min(knots.len())];
        let sum = |of: fn(&KnotSums) -> &[f64; 8]| near.iter().map(|knot| of(knot)[j]).sum::<f64>();
        let (gg, gp, pp) = (sum(|k| &k.phase_phase), sum(|k| &k.phase_wire), sum(|k| &k.wire_wire));
        let (gr, pr) = (sum(|k| &k.phase_difference), sum(|k| &k.wire_difference));
        let determinant = gg * pp - gp * gp;
        if determinant <= 1e-3 * gg * pp {
            return Self { error_rad: 0.0, feigned: 0.0 };
        }
        Self { error_rad: (gg * pr - gp * gr) / determinant, feigned: gp * gp / (gg * pp) }
    }

    fn left(&self, knot: &KnotSums, j: usize) -> f64 {
        knot.phase_phase[j] * (1.0 - self.feigned)
    }
}

/// Most that the contours' readings of neighbouring lines are taken to share, and in Lang lay, where a wire stays in the outline
/// for longer.
const MOST_SHARED: f64 = 0.95;
const MOST_SHARED_LANG: f64 = 0.975;

/// Variance of one contour reading in px^2, raised by what neighbouring readings share (as in a first-order autoregression).
fn contour_variance_px2(knots: &[KnotSums], most_shared: f64) -> f64 {
    let (squares, count, products) = knots.iter().fold((0.0, 0.0, 0.0), |t, k| {
        (t.0 + k.contour_squares.0, t.1 + k.contour_squares.1, t.2 + k.contour_squares.2)
    });
    let share = (products / f64::max(squares, 1e-9)).clamp(0.0, most_shared);
    (squares / f64::max(count, 1.0)).max(0.01) * (1.0 + share) / (1.0 - share)
}

/// Joins the views: information adds up.
pub fn fuse<'a>(views: impl Iterator<Item = &'a [Measurement]>, len: usize) -> Vec<Measurement> {
    let mut fused = vec![Measurement::default(); len];
    for view in views {
        for (f, m) in fused.iter_mut().zip(view) {
            let information = f.information + m.information;
            if m.information > 0.0 {
                f.value_rad += (m.value_rad - f.value_rad) * m.information / information;
                f.information = information;
            }
        }
    }
    fused
}
