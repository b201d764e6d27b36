//! Lay lengths and phases of a stretch, looseness and diameter, each with its uncertainty, or the reason why there is none.

use super::aligner::AlignerSpec;
use super::course::Course;
use super::courses::{JointCourses, StrandCourses, courses_of_view, joint_courses};
use super::diameter::{Diameters, WithSd, diameters};
use super::error_ratios::ErrorRatios;
use super::looseness::spread;
use super::measured::{Measured, Views};
use super::wire_tracking::coherence;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Why a stretch could not be aligned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NotAligned {
    /// No view has lines here.
    LinesLost,
    /// No view shows the two edges of a rope.
    NoRope,
    /// Edges were found, but they are not those of this rope.
    ContoursDisagree {
        /// Agreement with the model's contours (eq. 13); 1 is perfect.
        score: f64,
    },
}

impl std::fmt::Display for NotAligned {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::LinesLost => write!(f, "no view has lines here"),
            Self::NoRope => write!(f, "no view shows the two edges of a rope"),
            Self::ContoursDisagree { score } => write!(
                f,
                "the contours agree only {score:.2} with those of this rope, at least {:.2} is needed",
                super::aligner::LEAST_SCORE
            ),
        }
    }
}

/// A lay length with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayEstimate {
    /// Lay length in mm, signed.
    pub lay_mm: f64,
    /// Its standard deviation in mm.
    pub lay_sd_mm: f64,
    /// Phase at the middle line in rad, rope axes.
    pub phase_rad: f64,
    /// Its standard deviation in rad.
    pub phase_sd_rad: f64,
    /// Agreement of image and model in [0, 1].
    pub score: f64,
}

/// What one view, or all together, say of a stretch.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StretchEstimate {
    /// The strands: phase is that of strand 0.
    pub strand: Option<LayEstimate>,
    /// The wires of each strand: phase is that of wire 0.
    pub wires: Vec<Option<LayEstimate>>,
}

/// Everything estimated of a stretch.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimates {
    /// All views together.
    pub fused: StretchEstimate,
    /// Each view alone.
    pub views: Vec<StretchEstimate>,
    /// Lines per knot of the courses below.
    pub knot_lines: usize,
    /// `strand_phases_rad[knot * strands + j]`: smoothed, in rope axes.
    pub strand_phases_rad: Vec<f64>,
    /// `wire_phases_rad[knot * strands + j]` of wire 0; NaN where the wires of a strand are not known.
    pub wire_phases_rad: Vec<f64>,
    /// Looseness: root mean square of the strands' deviations from their regular places in rad; `None` if some strand is not known.
    pub strand_spread_rad: Option<WithSd>,
    /// What the contours say of the diameter.
    pub diameters: Diameters,
}

impl Estimates {
    /// Strands whose wires were not found: nothing on them is judged.
    pub fn strands_without_wires(&self) -> Vec<usize> {
        let strands = self.fused.wires.len();
        let lost = |j: &usize| self.wire_phases_rad.iter().skip(*j).step_by(strands).any(|phase| phase.is_nan());
        (0..strands).filter(lost).collect()
    }
}

/// What a stretch leaves of what those before it said of the encoder.
const ENCODER_FADING: f64 = 0.97;

/// Estimates the stretch `at` of a window of measured stretches.
pub(super) fn estimate(
    spec: &AlignerSpec,
    views: &mut Views,
    window: &[&Measured],
    at: usize,
) -> Result<Estimates, NotAligned> {
    let here = window[at];
    let (Ok(fit), Some(reference)) = (here.fit, &here.reference) else { return Err(NotAligned::NoRope) };
    // Only neighbours without a gap belong to the same course.
    let from = window[..at].iter().rposition(|m| m.reference.is_none()).map_or(0, |k| k + 1);
    let to = window[at + 1..].iter().position(|m| m.reference.is_none()).map_or(window.len(), |k| at + 1 + k);
    let first_knot: usize = window[from..at].iter().map(|m| m.knots(spec)).sum();
    let window = &window[from..to];
    let n = spec.rope.strands();
    let knots = first_knot..first_knot + here.knots(spec);
    let rates: Vec<Option<f64>> = (0..n).map(|j| measured_rate(spec, here, j)).collect();
    let JointCourses { strands: fused_courses, encoder } = joint_courses(spec, window, &views.encoder, |j| rates[j]);
    if let Some(encoder) = &encoder {
        let looked_at: usize = window.iter().map(|m| m.knots(spec)).sum();
        views.encoder.learn(&encoder.evidence, ENCODER_FADING, knots.len() as f64 / looked_at as f64);
    }
    let step = spec.rope.strand_step_rad();
    let mut strand_phases_rad = Vec::with_capacity(knots.len() * n);
    let mut wire_phases_rad = Vec::with_capacity(knots.len() * n);
    for (k, knot) in knots.clone().enumerate() {
        for (j, courses) in fused_courses.iter().enumerate() {
            let straight = reference.mean_phase_rad(reference.knot_middle(k)) + j as f64 * step;
            strand_phases_rad.push(courses.strand.as_ref().map_or(straight, |c| c.phase_rad(knot)));
            wire_phases_rad.push(courses.wires.as_ref().map_or(f64::NAN, |c| c.phase_rad(knot)));
        }
    }
    let grid = here.grid(spec);
    let middle_mm = (here.first_line as f64 + (here.lines as f64 - 1.0) / 2.0) * spec.pitch_mm;
    let of = |courses: &[StrandCourses], view: Option<usize>| StretchEstimate {
        strand: strand_estimate(courses, &knots, step, grid.knot_mm(0), middle_mm, spec, fit.score),
        wires: (0..n)
            .map(|j| {
                let course = courses[j].wires.as_ref()?;
                let seen: Vec<_> = here
                    .stripes
                    .iter()
                    .zip(&views.shifts)
                    .enumerate()
                    .filter(|(v, _)| view.is_none_or(|only| only == *v))
                    .map(|(_, s)| s)
                    .collect();
                let phase_at = |mm: f64| interpolate(course, &knots, grid.knot_mm(0), mm, spec);
                let score = coherence(&spec.rope, &seen, j, grid, phase_at);
                lay_estimate(course, &knots, phase_at(middle_mm), score)
            })
            .collect(),
    };
    let mut fused = of(&fused_courses, None);
    let mut per_view: Vec<StretchEstimate> = (0..here.views.len())
        .into_par_iter()
        .map(|v| {
            if here.strands.views.get(v).is_none_or(|knots| knots.iter().all(|m| m.information <= 0.0)) {
                return StretchEstimate { strand: None, wires: vec![None; n] };
            }
            of(&courses_of_view(spec, window, v, encoder.as_ref(), |j| rates[j]), Some(v))
        })
        .collect();
    if let Some(strand) = &mut fused.strand {
        views.agreement.learn(strand, per_view.iter().filter_map(|view| view.strand.as_ref()));
        let scale = views.agreement.scale();
        for strand in per_view.iter_mut().filter_map(|view| view.strand.as_mut()).chain([strand]) {
            strand.lay_sd_mm *= scale;
            strand.phase_sd_rad *= scale;
        }
    }
    let ratios = ErrorRatios::of(here.views.len(), reference.is_ordinary());
    // A view alone keeps its word; where there is no other, it is what all say together.
    let alone = if here.views.len() == 1 { &mut per_view[..] } else { &mut [] };
    alone.iter_mut().chain([&mut fused]).for_each(|estimate| ratios.make_good(estimate));
    let strands: Vec<&Course> = fused_courses.iter().filter_map(|courses| courses.strand.as_ref()).collect();
    let strand_spread_rad = spread(&strands, knots, &strand_phases_rad, step, views.agreement.scale());
    let diameters = diameters(spec, views, here, reference, ratios.diameter);
    Ok(Estimates {
        fused,
        views: per_view,
        knot_lines: spec.knot_lines,
        strand_phases_rad,
        wire_phases_rad,
        strand_spread_rad,
        diameters,
    })
}

/// Rough wire rate of strand `j` in rad/mm from the measurements of a stretch themselves.
pub(super) fn measured_rate(spec: &AlignerSpec, here: &Measured, j: usize) -> Option<f64> {
    let spacing = spec.knot_lines as f64 * spec.pitch_mm;
    let (mut w, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for view in &here.wires {
        for (k, m) in view[j].iter().map(|knot| knot.measured).enumerate().filter(|(_, m)| m.information > 0.0) {
            let at = k as f64 * spacing;
            w += m.information;
            x += m.information * at;
            y += m.information * m.value_rad;
            xx += m.information * at * at;
            xy += m.information * at * m.value_rad;
        }
    }
    let determinant = w * xx - x * x;
    (determinant > 0.0).then(|| (w * xy - x * y) / determinant)
}

fn interpolate(course: &Course, knots: &std::ops::Range<usize>, first_mm: f64, mm: f64, spec: &AlignerSpec) -> f64 {
    let at = (mm - first_mm) / (spec.knot_lines as f64 * spec.pitch_mm);
    let knot = (at.round().max(0.0) as usize).min(knots.len() - 1);
    let off_mm = (at - knot as f64) * spec.knot_lines as f64 * spec.pitch_mm;
    course.phase_rad(knots.start + knot) + course.rate_rad_per_mm(knots.start + knot) * off_mm
}

fn lay_estimate(course: &Course, knots: &std::ops::Range<usize>, phase_rad: f64, score: f64) -> Option<LayEstimate> {
    let slope = course.slope_rad_per_mm(knots.clone());
    let lay_mm = TAU / slope;
    let lay_sd_mm = lay_mm * lay_mm / TAU * course.slope_variance(knots.clone()).sqrt();
    (lay_mm.is_finite() && lay_sd_mm < 0.05 * lay_mm.abs()).then_some(LayEstimate {
        lay_mm,
        lay_sd_mm,
        phase_rad,
        phase_sd_rad: course.phase_variance(middle_knot(knots)).sqrt(),
        score,
    })
}

/// The knot that the phase in the middle of a stretch is told by.
fn middle_knot(knots: &std::ops::Range<usize>) -> usize {
    (knots.start + knots.end) / 2
}

/// Mean over the strands: the rope's phase and lay are those of its strands on average.
fn strand_estimate(
    courses: &[StrandCourses],
    knots: &std::ops::Range<usize>,
    step_rad: f64,
    first_mm: f64,
    middle_mm: f64,
    spec: &AlignerSpec,
    score: f64,
) -> Option<LayEstimate> {
    let known: Vec<(usize, &Course)> =
        courses.iter().enumerate().filter_map(|(j, c)| Some((j, c.strand.as_ref()?))).collect();
    if known.is_empty() {
        return None;
    }
    let n = known.len() as f64;
    let slope = known.iter().map(|(_, c)| c.slope_rad_per_mm(knots.clone())).sum::<f64>() / n;
    let courses: Vec<&Course> = known.iter().map(|(_, course)| *course).collect();
    let variance = Course::mean_slope_variance(&courses, knots.clone());
    let phase_rad =
        known.iter().map(|(j, c)| interpolate(c, knots, first_mm, middle_mm, spec) - *j as f64 * step_rad).sum::<f64>()
            / n;
    let lay_mm = TAU / slope;
    let lay_sd_mm = lay_mm * lay_mm / TAU * variance.sqrt();
    (lay_mm.is_finite() && lay_sd_mm < 0.05 * lay_mm.abs()).then_some(LayEstimate {
        lay_mm,
        lay_sd_mm,
        phase_rad,
        phase_sd_rad: Course::mean_phase_variance(&courses, middle_knot(knots)).sqrt(),
        score,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strand_whose_wires_are_not_known_is_told() {
        let of = |wire_phases_rad: Vec<f64>| Estimates {
            fused: StretchEstimate { strand: None, wires: vec![None; 3] },
            views: Vec::new(),
            knot_lines: 1,
            strand_phases_rad: vec![0.0; 6],
            wire_phases_rad,
            strand_spread_rad: None,
            diameters: Diameters::default(),
        };
        assert_eq!(of(vec![0.1; 6]).strands_without_wires(), [0; 0]);
        let unknown = f64::NAN;
        assert_eq!(of(vec![0.1, 0.2, unknown, 0.1, 0.2, unknown]).strands_without_wires(), [2]);
        assert_eq!(of(vec![unknown; 6]).strands_without_wires(), [0, 1, 2]);
    }
}
