//! Finds the wires in a few gathered stretches whose strands are known: search, count, light's shift, and their pattern.

use super::aligner::AlignerSpec;
use super::courses::{StrandCourses, joint_courses, predict_wires};
use super::encoder::EncoderEvidence;
use super::estimates::measured_rate;
use super::lock::runs;
use super::measured::{Measured, Views};
use super::measuring::{learn_pattern, measure_wires, read_wires, renew_patterns};
use super::noise_scale::{normalised, residual_scale};
use super::outline_detail::DetailSums;
use super::smoothing::Measurement;
use super::unwrapping::{FACETS, Stripe, search_rate, turned_sum};
use super::wire_count::{CountedRate, recount};
use super::wire_pattern::PatternSums;
use super::wire_prediction::WirePrediction;
use super::wire_tracking::{ShiftSums, WireKnot, searched_rates};
use rayon::prelude::*;

/// Stretches over which the wires are searched: about two lays of the strands.
const WIRE_SEARCH_STRETCHES: usize = 3;
/// Share of coherent stripes below which no wires were found.
pub(super) const LEAST_COHERENCE: f64 = 0.3;

/// Searches the wires of every strand, tracks them through the gathered stretches, and learns where light shifts the stripes.
pub(super) fn lock_wires(
    spec: &AlignerSpec,
    views: &mut Views,
    gathered: &mut [Measured],
) -> Vec<Option<WirePrediction>> {
    let n = spec.rope.strands();
    let nothing = vec![None; n];
    gathered.par_iter_mut().for_each(|measured| read_wires(spec, views, measured, &nothing));
    let Some(first) = gathered.iter().position(|m| m.reference.is_some()) else { return vec![None; n] };
    let run = gathered[first..].iter().take_while(|m| m.reference.is_some()).count();
    let searched: Vec<&Measured> = gathered[first..first + run.min(WIRE_SEARCH_STRETCHES)].iter().collect();
    let mut start: Vec<Option<WirePrediction>> = {
        let views = &*views;
        (0..n).into_par_iter().map(|j| search_wires(spec, views, &searched, j)).collect()
    };
    // How fast the wires turn is known now, and with it what is theirs in the templates.
    gathered.par_iter_mut().for_each(|measured| read_wires(spec, views, measured, &start));
    let mut wires = start.clone();
    for round in 0..3 {
        wires = start.clone();
        for k in first..gathered.len() {
            let (before, rest) = gathered.split_at_mut(k);
            if rest[0].reference.is_none() {
                continue;
            }
            measure_wires(spec, views, &mut rest[0], &wires);
            let window: Vec<&Measured> = before[first.max(k.saturating_sub(2))..].iter().chain([&rest[0]]).collect();
            wires = predict_wires(spec, &window, &views.encoder, &wires);
        }
        if round == 0 && !spec.sees_all_round() {
            let rates = recounted(spec, &views.encoder, gathered, &start);
            for (prediction, rate) in start.iter_mut().zip(rates) {
                if let (Some(prediction), Some(rate)) = (prediction, rate) {
                    prediction.rate_rad_per_mm = rate;
                }
            }
        }
        let all = runs(gathered);
        let rates = |j: usize| start[j].map(|p| p.rate_rad_per_mm);
        if round < 2 {
            let mut sums = ShiftSums::new(views.models.len());
            for run in &all {
                let window: Vec<&Measured> = run.iter().collect();
                let courses = joint_courses(spec, &window, &views.encoder, rates).strands;
                let mut knot = 0;
                for measured in *run {
                    add_shifts(spec, measured, &courses, knot, &mut sums);
                    knot += measured.knots(spec);
                }
            }
            views.shifts = sums.shifts();
        }
        if round == 1 {
            let mut series = Vec::new();
            for run in &all {
                let window: Vec<&Measured> = run.iter().collect();
                for (j, courses) in joint_courses(spec, &window, &views.encoder, rates).strands.into_iter().enumerate()
                {
                    if let (Some(strand), Some(wires)) = (courses.strand, courses.wires) {
                        let (of_strand, of_wires) = (strand.phase_variances(), wires.phase_variances());
                        for v in 0..views.models.len() {
                            let knots = run.iter().flat_map(|m| &m.wires[v][j]).enumerate();
                            let residual = |(k, knot): (usize, &WireKnot)| {
                                let share = knot.strand_share;
                                let expected = wires.phase_rad(k) + share * strand.phase_rad(k);
                                normalised(knot.joint(), expected, share * share * of_strand[k] + of_wires[k])
                            };
                            series.push(knots.map(residual).collect());
                        }
                    }
                }
            }
            if let Some(scale) = residual_scale(&series) {
                views.wire_noise_scale *= scale.clamp(0.05, 50.0);
            }
        }
    }
    wires
}

/// Wire rates of all strands over the gathered stretches, with the most plausible counts of wires between the passes.
fn recounted(
    spec: &AlignerSpec,
    known: &EncoderEvidence,
    gathered: &[Measured],
    start: &[Option<WirePrediction>],
) -> Vec<Option<f64>> {
    let run = runs(gathered).into_iter().max_by_key(|run| run.len()).unwrap_or_default();
    let window: Vec<&Measured> = run.iter().collect();
    let Some(reference) = run.first().and_then(|m| m.reference.as_ref()) else { return vec![None; start.len()] };
    let courses = joint_courses(spec, &window, known, |j| start[j].map(|p| p.rate_rad_per_mm)).strands;
    let rates: Vec<Option<CountedRate>> = courses
        .iter()
        .enumerate()
        .map(|(j, course)| {
            let wires = course.wires.as_ref()?;
            let over_passes = wires.slope_rad_per_mm(0..wires.len());
            Some(CountedRate { over_passes, within_passes: rate_within_passes(spec, run, j)? })
        })
        .collect();
    recount(&spec.rope, reference.rate_rad_per_mm, &rates)
}

/// Rate of the wires of strand `j` in rad/mm from their courses within single passes before a camera: between two passes nobody
/// counts the wires, and a wrong count would make every later pass agree with itself.
fn rate_within_passes(spec: &AlignerSpec, gathered: &[Measured], j: usize) -> Option<f64> {
    let (mut xx, mut xy, mut knots) = (0.0, 0.0, 0);
    for measured in gathered.iter().filter(|m| m.reference.is_some()) {
        let grid = measured.grid(spec);
        for view in &measured.wires {
            let seen: Vec<(f64, Measurement)> =
                view[j].iter().enumerate().map(|(k, knot)| (grid.knot_mm(k), knot.measured)).collect();
            for pass in seen.split(|(_, m)| m.information <= 0.0).filter(|pass| pass.len() >= 3) {
                let weight: f64 = pass.iter().map(|(_, m)| m.information).sum();
                let mean = |of: fn(&(f64, Measurement)) -> f64| {
                    pass.iter().map(|knot| knot.1.information * of(knot)).sum::<f64>() / weight
                };
                let (x, y) = (mean(|k| k.0), mean(|k| k.1.value_rad));
                for (at, m) in pass {
                    xx += m.information * (at - x).powi(2);
                    xy += m.information * (at - x) * (m.value_rad - y);
                }
                knots += pass.len();
            }
        }
    }
    (knots >= 8 && xx > 0.0).then(|| xy / xx)
}

/// Learns the wire patterns anew from all gathered stretches. Answers where the wires are in each: phase and rate about its middle.
pub(super) fn learn_patterns(
    spec: &AlignerSpec,
    views: &mut Views,
    gathered: &[Measured],
) -> Vec<Vec<Option<WirePrediction>>> {
    let n = spec.rope.strands();
    views.pattern_sums = views.models.iter().map(|_| PatternSums::new(spec.width_px)).collect();
    views.detail_sums = vec![DetailSums::default(); views.models.len()];
    let mut predictions = vec![vec![None; n]; gathered.len()];
    let mut at = 0;
    for (k, measured) in gathered.iter().enumerate() {
        if measured.reference.is_none() {
            at = k + 1;
            continue;
        }
        let window: Vec<&Measured> =
            gathered[at..].iter().take_while(|m| m.reference.is_some()).take(k + 2 - at).collect();
        let courses = joint_courses(spec, &window, &views.encoder, |j| measured_rate(spec, measured, j)).strands;
        let first_knot: usize = gathered[at..k].iter().map(|m| m.knots(spec)).sum();
        learn_pattern(spec, views, measured, &courses, first_knot);
        let knots = measured.knots(spec);
        let middle = first_knot + knots / 2;
        for (prediction, course) in predictions[k].iter_mut().zip(&courses) {
            *prediction = course.wires.as_ref().map(|c| WirePrediction {
                phase_rad: c.phase_rad(middle),
                rate_rad_per_mm: c.slope_rad_per_mm(first_knot..first_knot + knots),
                position_mm: measured.grid(spec).knot_mm(knots / 2),
            });
        }
    }
    renew_patterns(spec, views);
    predictions
}

fn add_shifts(
    spec: &AlignerSpec,
    measured: &Measured,
    courses: &[StrandCourses],
    first_knot: usize,
    sums: &mut ShiftSums,
) {
    let n = spec.rope.strands();
    let grid = measured.grid(spec);
    for (v, stripes) in measured.stripes.iter().enumerate() {
        for (reading, row) in stripes.stripes.chunks_exact(n).enumerate() {
            let knot = grid.knot_of(reading);
            for (j, course) in courses.iter().enumerate() {
                if let (Some(course), true) = (&course.wires, row[j].pixels > 0.0) {
                    let at = first_knot + knot;
                    let off_mm = grid.reading_mm(reading) - grid.knot_mm(knot);
                    let phase = course.phase_rad(at) + course.rate_rad_per_mm(at) * off_mm;
                    sums.add(v, spec.rope.wires(), &row[j], phase);
                }
            }
        }
    }
}

/// Gap between two readings that separates two passes of a strand before a camera, in mm.
const PASS_GAP_MM: f64 = 4.0;

/// The wires of strand `j` over a few stretches, all views together. `None` if nothing coherent is found.
pub(super) fn search_wires(
    spec: &AlignerSpec,
    views: &Views,
    stretches: &[&Measured],
    j: usize,
) -> Option<WirePrediction> {
    let n = spec.rope.strands();
    let of_view = |v: usize| -> Vec<(f64, Stripe)> {
        let of_stretch = |measured: &&Measured| {
            let grid = measured.grid(spec);
            let rows = measured.stripes[v].stripes.chunks_exact(n).enumerate();
            rows.filter(|(_, row)| row[j].pixels > 0.0).map(|(r, row)| (grid.reading_mm(r), row[j])).collect::<Vec<_>>()
        };
        stretches.iter().flat_map(of_stretch).collect()
    };
    let by_view: Vec<_> = (0..views.models.len()).map(of_view).collect();
    let passes: Vec<&[(f64, Stripe)]> = by_view
        .iter()
        .flat_map(|view| view.chunk_by(|a, b| b.0 - a.0 < PASS_GAP_MM))
        .filter(|pass| pass.len() >= 8)
        .collect();
    let (rate, coherence) = searched_rates(&spec.rope)
        .into_iter()
        .filter_map(|range| search_rate(spec.rope.wires(), &passes, range))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    if coherence < LEAST_COHERENCE {
        return None;
    }
    // The phase of the longest pass, on the facets that look at the camera: shifts of the others are learnt against it.
    let pass = passes.iter().max_by(|a, b| (a[a.len() - 1].0 - a[0].0).total_cmp(&(b[b.len() - 1].0 - b[0].0)))?;
    let m = spec.rope.wires() as f64;
    let position_mm = pass[pass.len() / 2].0;
    let facing = |(x, s): &(f64, Stripe)| {
        let sum = |parts: &[f32; FACETS]| f64::from(parts[FACETS / 2 - 1] + parts[FACETS / 2]);
        (*x, (sum(&s.re), sum(&s.im)))
    };
    let (re, im) = turned_sum(m, pass.iter().map(facing), rate, position_mm);
    Some(WirePrediction { phase_rad: -im.atan2(re) / m, rate_rad_per_mm: rate, position_mm })
}
