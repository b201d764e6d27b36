//! Smoothed courses of the strands and their wires over consecutive stretches.

use super::aligner::AlignerSpec;
use super::course::Course;
use super::encoder::{EncoderCourse, EncoderEvidence};
use super::estimates::measured_rate;
use super::measured::Measured;
use super::smoothing::{Chain, CoursePrior, Measurement, Observation, smooth};
use super::stretch::fuse;
use super::wire_prediction::WirePrediction;
use rayon::prelude::*;
use std::sync::Arc;

/// Change of the strands' rate along the rope: spectral density times the cube of the rope diameter, in rad^2. Deviations of
/// a few hundredths of a rad over a few rope diameters are usual.
const STRAND_WANDER: f64 = 1e-4;
/// The same for wires, in strand diameters: they keep their lay much better.
const WIRE_WANDER: f64 = 1e-6;
/// And where the encoder's error is not taken out of them.
const WIRE_WANDER_WITH_ENCODER: f64 = 5e-6;

pub(super) fn strand_prior(spec: &AlignerSpec, rate_rad_per_mm: f64) -> CoursePrior {
    CoursePrior {
        spacing_mm: spec.knot_lines as f64 * spec.pitch_mm,
        wander: STRAND_WANDER / spec.rope.diameter_mm().powi(3),
        rate_rad_per_mm,
        rate_sd: 0.05 * rate_rad_per_mm.abs(),
    }
}

pub(super) fn wire_prior(spec: &AlignerSpec, rate_rad_per_mm: f64) -> CoursePrior {
    let wander = if spec.sees_all_round() { WIRE_WANDER } else { WIRE_WANDER_WITH_ENCODER };
    CoursePrior {
        spacing_mm: spec.knot_lines as f64 * spec.pitch_mm,
        wander: wander / (8.0 * spec.rope.strand_radius_mm().powi(3) * 8.0),
        rate_rad_per_mm,
        rate_sd: 0.05 * rate_rad_per_mm.abs(),
    }
}

pub(super) fn with<'a>(before: &[&'a Measured], seen: &'a Measured) -> Vec<&'a Measured> {
    let mut window: Vec<&Measured> = before.iter().copied().rev().take_while(|m| m.reference.is_some()).collect();
    window.reverse();
    window.push(seen);
    window
}

/// Smoothed course of every strand over consecutive stretches; `view`: only what that view saw.
pub(super) fn strand_courses(
    spec: &AlignerSpec,
    window: &[&Measured],
    view: Option<usize>,
    rate: f64,
) -> Vec<Option<Course>> {
    let n = spec.rope.strands();
    let fused: Vec<Vec<Measurement>> = window
        .iter()
        .map(|m| {
            let views = m
                .strands
                .views
                .iter()
                .enumerate()
                .filter(|(v, _)| view.is_none_or(|only| only == *v))
                .map(|(_, x)| &x[..]);
            fuse(views, m.knots(spec) * n)
        })
        .collect();
    (0..n)
        .into_par_iter()
        .map(|j| {
            let knots: Vec<Measurement> = fused.iter().flat_map(|f| f.chunks_exact(n).map(move |k| k[j])).collect();
            smooth(&knots, strand_prior(spec, rate))
        })
        .collect()
}

/// Smoothed courses of a strand and of its wires.
#[derive(Debug, Clone, Default)]
pub(super) struct StrandCourses {
    pub strand: Option<Course>,
    pub wires: Option<Course>,
}

/// What several views together say of the strands and their wires, and of the encoder.
#[derive(Debug, Clone, Default)]
pub(super) struct JointCourses {
    pub strands: Vec<StrandCourses>,
    /// Absent where no strand's wires are known.
    pub encoder: Option<Arc<EncoderCourse>>,
}

/// Smoothed courses of every strand and its wires over consecutive stretches, with the encoder's error that they share; `known` is
/// what earlier rope said of that.
///
/// Strands and wires are solved for together: where a strand stands decides where its wires seem to be, and wires, which keep their
/// lay better than strands their places, tell where the strand stands.
pub(super) fn joint_courses(
    spec: &AlignerSpec,
    window: &[&Measured],
    known: &EncoderEvidence,
    wire_rates: impl Fn(usize) -> Option<f64>,
) -> JointCourses {
    let chains = chains(spec, window, None, wire_rates);
    let solved: Vec<&Chain<4>> = chains.iter().flatten().collect();
    // Over the gaps between passes an encoder's error would pass for another count of the wires.
    let encoder = if spec.sees_all_round() { EncoderCourse::estimate(&solved, known).map(Arc::new) } else { None };
    JointCourses { strands: courses_of(spec, window, None, chains, encoder.as_ref()), encoder }
}

/// The same as one view saw them, the encoder's error being that of all together.
pub(super) fn courses_of_view(
    spec: &AlignerSpec,
    window: &[&Measured],
    view: usize,
    encoder: Option<&Arc<EncoderCourse>>,
    wire_rates: impl Fn(usize) -> Option<f64>,
) -> Vec<StrandCourses> {
    courses_of(spec, window, Some(view), chains(spec, window, Some(view), wire_rates), encoder)
}

fn straight_rate(window: &[&Measured]) -> Option<f64> {
    window.iter().find_map(|m| m.reference.as_ref()).map(|r| r.rate_rad_per_mm)
}

/// Every strand with its wires, where these are known; `view`: only what that view saw.
fn chains(
    spec: &AlignerSpec,
    window: &[&Measured],
    view: Option<usize>,
    wire_rates: impl Fn(usize) -> Option<f64>,
) -> Vec<Option<Chain<4>>> {
    let n = spec.rope.strands();
    let wanted = |v: usize| view.is_none_or(|only| only == v);
    let Some(rate) = straight_rate(window) else { return (0..n).map(|_| None).collect() };
    let joint = |j: usize, wire_rate: f64| {
        let mut observations: Vec<Observation<4>> = Vec::new();
        for m in window {
            for k in 0..m.knots(spec) {
                let mut observation = Observation::default();
                for (_, strands) in m.strands.views.iter().enumerate().filter(|(v, s)| wanted(*v) && !s.is_empty()) {
                    observation.add(&[1.0, 0.0], strands[k * n + j]);
                }
                for (_, wires) in m.wires.iter().enumerate().filter(|(v, _)| wanted(*v)) {
                    observation.add(&[wires[j][k].strand_share, 1.0], wires[j][k].joint());
                }
                observations.push(observation);
            }
        }
        Chain::new(observations, &[strand_prior(spec, rate), wire_prior(spec, wire_rate)])
    };
    let seen_wires = |j: usize| {
        let views = window.iter().flat_map(|m| m.wires.iter().enumerate().filter(|(v, _)| wanted(*v)));
        views.flat_map(|(_, w)| &w[j]).filter(|knot| knot.measured.information > 0.0).count() >= 2
    };
    let rates: Vec<Option<f64>> = (0..n).map(|j| wire_rates(j).filter(|_| seen_wires(j))).collect();
    rates.into_par_iter().enumerate().map(|(j, wire_rate)| wire_rate.and_then(|rate| joint(j, rate))).collect()
}

fn courses_of(
    spec: &AlignerSpec,
    window: &[&Measured],
    view: Option<usize>,
    chains: Vec<Option<Chain<4>>>,
    encoder: Option<&Arc<EncoderCourse>>,
) -> Vec<StrandCourses> {
    let mut alone = None;
    let mut alone_of = |j: usize| {
        let rate = straight_rate(window)?;
        alone.get_or_insert_with(|| strand_courses(spec, window, view, rate))[j].take()
    };
    let together: Vec<Option<Vec<Course>>> =
        chains.into_par_iter().map(|chain| chain.map(|chain| chain.courses(encoder))).collect();
    together
        .into_iter()
        .enumerate()
        .map(|(j, courses)| match courses {
            Some(mut courses) => StrandCourses { wires: courses.pop(), strand: courses.pop() },
            None => StrandCourses { strand: alone_of(j), wires: None },
        })
        .collect()
}

/// Where the wires of every strand are expected at the end of the last stretch.
pub(super) fn predict_wires(
    spec: &AlignerSpec,
    window: &[&Measured],
    known: &EncoderEvidence,
    now: &[Option<WirePrediction>],
) -> Vec<Option<WirePrediction>> {
    let contiguous = match window.split_last() {
        Some((last, before)) => with(before, last),
        None => return now.to_vec(),
    };
    let courses = joint_courses(spec, &contiguous, known, |j| {
        contiguous.last().and_then(|m| measured_rate(spec, m, j)).or(now[j].map(|p| p.rate_rad_per_mm))
    });
    let Some(last) = contiguous.last() else { return now.to_vec() };
    let grid = last.grid(spec);
    courses
        .strands
        .iter()
        .zip(now)
        .map(|(course, now)| match &course.wires {
            Some(course) => {
                let knot = course.len() - 1;
                Some(WirePrediction {
                    phase_rad: course.phase_rad(knot),
                    // The rate at the very end is the least certain; lays change little over half a stretch.
                    rate_rad_per_mm: course.slope_rad_per_mm(course.len() - grid.knots..course.len()),
                    position_mm: grid.knot_mm(grid.knots - 1),
                })
            }
            None => *now,
        })
        .collect()
}
