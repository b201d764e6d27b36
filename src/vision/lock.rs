//! Finds a rope in a few gathered stretches: strands by their contours, then camera, template, each strand's course, wires.

use super::aligner::{AlignerSpec, Measured, Views};
use super::camera::Camera;
use super::camera_distance::{ContourHarmonics, DEFAULT_DISTANCE_DIAMETERS, estimate};
use super::courses::{StrandCourses, joint_courses, predict_wires, strand_courses};
use super::estimates::measured_rate;
use super::fitting::fit_from;
use super::measuring::{learn_pattern, measure, measure_wires, renew_patterns};
use super::model_contour::ModelContour;
use super::outline_detail::DetailSums;
use super::smoothing::Measurement;
use super::stretch::{Reference, ViewModel};
use super::template::{Template, TemplateSums};
use super::unwrapping::{FACETS, LINE_STRIDE, Stripe, StripeTable, search_rate, turned_sum};
use super::wire_count::{CountedRate, recount};
use super::wire_pattern::PatternSums;
use super::wire_tracking::{ShiftSums, StripeShift, WireKnot, WirePrediction, searched_rates};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Rounds of registration and template learning; each sharpens the template for the next.
const ROUNDS: usize = 2;
/// Stretches over which the wires are searched: about two lays of the strands.
const WIRE_SEARCH_STRETCHES: usize = 3;
/// Share of coherent stripes below which no wires were found.
pub(super) const LEAST_COHERENCE: f64 = 0.3;

/// What a lock knows.
#[derive(Debug)]
pub(super) struct Lock {
    pub views: Views,
    pub wires: Vec<Option<WirePrediction>>,
}

/// Locks on the gathered stretches and measures them all. `None` if no stretch shows a rope; then every fit says why.
pub(super) fn lock(spec: &AlignerSpec, known: Option<Views>, gathered: &mut [Measured]) -> Option<Lock> {
    let mut views = match known {
        Some(views) => views,
        None => first_views(spec, gathered),
    };
    let unknown = vec![None; spec.rope.strands()];
    let mut spec_now = spec.clone();
    fit_all(&spec_now, &views.models, gathered)?;
    if views.models.iter().all(|m| m.template.is_none()) {
        place_cameras(spec, &mut views, gathered);
        fit_all(&spec_now, &views.models, gathered)?;
        measure_all(spec, &mut views, gathered, &|_| unknown.clone());
        first_templates(spec, &mut views, gathered);
        if spec.rope.design().strand_lay_mm.is_none() && wrong_hand(&views) {
            // The strands slant the other way: mirror the search. Contours alone could not tell.
            let lay = gathered.iter().find_map(|m| m.fit.ok()).map(|f| -TAU / f.rate_rad_per_mm)?;
            spec_now = spec.with_strand_lay(lay)?;
            fit_all(&spec_now, &views.models, gathered)?;
            views.models.iter_mut().for_each(|m| m.template = None);
            measure_all(spec, &mut views, gathered, &|_| unknown.clone());
            first_templates(spec, &mut views, gathered);
        }
        for _ in 0..ROUNDS {
            measure_all(spec, &mut views, gathered, &|_| unknown.clone());
            first_templates(spec, &mut views, gathered);
        }
        measure_all(spec, &mut views, gathered, &|_| unknown.clone());
        lock_wires(spec, &mut views, gathered);
        // With the wires known, their pattern is learnt and taken out, and everything is measured again.
        for _ in 0..ROUNDS {
            let predictions = learn_patterns(spec, &mut views, gathered);
            measure_all(spec, &mut views, gathered, &|k| predictions[k].clone());
            first_templates(spec, &mut views, gathered);
            calibrate_strands(spec, &mut views, gathered);
        }
        let predictions = learn_patterns(spec, &mut views, gathered);
        measure_all(spec, &mut views, gathered, &|k| predictions[k].clone());
    } else {
        measure_all(spec, &mut views, gathered, &|_| unknown.clone());
    }
    let wires = lock_wires(spec, &mut views, gathered);
    Some(Lock { views, wires })
}

/// Cameras at the usual distance, scaled to the width that the contours show.
fn first_views(spec: &AlignerSpec, gathered: &[Measured]) -> Views {
    let distance_mm = DEFAULT_DISTANCE_DIAMETERS * spec.rope.diameter_mm();
    let models = spec
        .view_angles_rad
        .iter()
        .enumerate()
        .map(|(v, &angle_rad)| view_model(spec, gathered, v, angle_rad, distance_mm))
        .collect::<Vec<_>>();
    Views {
        sums: models.iter().map(|_| TemplateSums::new(spec.width_px)).collect(),
        pattern_sums: models.iter().map(|_| PatternSums::new(spec.width_px)).collect(),
        shifts: models.iter().map(|_| StripeShift::default()).collect(),
        detail_sums: vec![DetailSums::default(); models.len()],
        models,
        wire_noise_scale: 1.0,
        table: StripeTable::new(spec.rope.wires()),
        diameter_mm: spec.rope.diameter_mm(),
    }
}

fn view_model(spec: &AlignerSpec, gathered: &[Measured], v: usize, angle_rad: f64, distance_mm: f64) -> ViewModel {
    let mut widths: Vec<f32> = gathered
        .iter()
        .filter_map(|m| m.views.get(v))
        .flat_map(|view| view.contours.lower_px.iter().zip(&view.contours.upper_px).map(|(l, u)| u - l))
        .filter(|w| w.is_finite())
        .collect();
    let unit = ModelContour::new(&spec.rope, &Camera { angle_rad, distance_mm, px_per_mm: 1.0 });
    let width_px = if widths.is_empty() {
        spec.rope_width_px.unwrap_or(spec.width_px as f64 * 0.8)
    } else {
        // Mean of the middle half: the outline's own distribution is symmetric enough, wire ends and losses are not.
        let n = widths.len();
        widths.sort_by(f32::total_cmp);
        let middle = &widths[n / 4..(3 * n / 4).max(n / 4 + 1)];
        middle.iter().map(|&w| f64::from(w)).sum::<f64>() / middle.len() as f64
    };
    let camera = Camera { angle_rad, distance_mm, px_per_mm: width_px / unit.mean_width_px() };
    ViewModel {
        camera,
        contour: ModelContour::new(&spec.rope, &camera),
        template: None,
        pattern: None,
        detail: None,
        noise_scale: 1.0,
    }
}

/// Fits every stretch: the best on its own, the others outward from it. `None` if not one can be fitted.
fn fit_all(spec: &AlignerSpec, models: &[ViewModel], gathered: &mut [Measured]) -> Option<()> {
    let alone: Vec<_> = gathered.iter().map(|m| fit_from(spec, models, m, None)).collect();
    for (measured, fit) in gathered.iter_mut().zip(&alone) {
        measured.fit = *fit;
    }
    let score = |k: usize| alone[k].as_ref().map_or(f64::NEG_INFINITY, |f| f.score);
    let best = (0..gathered.len()).max_by(|&a, &b| score(a).total_cmp(&score(b)))?;
    alone[best].ok()?;
    let follow = |gathered: &mut [Measured], from: usize, to: usize| {
        let fit = gathered[from].fit;
        if let Ok(fit) = fit {
            let reference = Reference::straight(&fit, &spec.rope, gathered[from].lines, spec.pitch_mm, spec.knot_lines);
            // Signed distance: stretches before the best one are reached backward.
            let shifted = reference_shifted(&reference, gathered[from].first_line, gathered[to].first_line);
            gathered[to].fit = fit_from(spec, models, &gathered[to], Some((gathered[to].first_line, &shifted)));
        }
    };
    for to in best + 1..gathered.len() {
        follow(gathered, to - 1, to);
    }
    for to in (0..best).rev() {
        follow(gathered, to + 1, to);
    }
    Some(())
}

/// The same straight course, with lines counted from another first line.
fn reference_shifted(reference: &Reference, from_line: usize, to_line: usize) -> Reference {
    let lines = to_line as f64 - from_line as f64;
    Reference {
        phase_rad: reference.phase_rad + reference.rate_rad_per_mm * lines * reference.pitch_mm,
        ..reference.clone()
    }
}

/// Estimates the camera distance from all contours, and scales the cameras again.
fn place_cameras(spec: &AlignerSpec, views: &mut Views, gathered: &[Measured]) {
    let mut harmonics = vec![ContourHarmonics::default(); views.models.len()];
    for measured in gathered {
        let Ok(fit) = measured.fit else { continue };
        let reference = Reference::straight(&fit, &spec.rope, measured.lines, spec.pitch_mm, spec.knot_lines);
        let period = TAU / fit.rate_rad_per_mm.abs() / spec.rope.strands() as f64 / spec.pitch_mm;
        for ((h, view), model) in harmonics.iter_mut().zip(&measured.views).zip(&views.models) {
            h.add(spec.rope.strands(), &view.contours, period.round().max(4.0) as usize, |line| {
                model.camera.phase_in_view(reference.mean_phase_rad(line as f64))
            });
        }
    }
    let distance_mm = estimate(&spec.rope, &harmonics).unwrap_or(DEFAULT_DISTANCE_DIAMETERS * spec.rope.diameter_mm());
    for (v, model) in views.models.iter_mut().enumerate() {
        *model = view_model(spec, gathered, v, model.camera.angle_rad, distance_mm);
    }
}

/// Learns the templates anew from all gathered stretches.
fn first_templates(spec: &AlignerSpec, views: &mut Views, gathered: &mut [Measured]) {
    for (v, (model, sums)) in views.models.iter_mut().zip(&mut views.sums).enumerate() {
        *sums = TemplateSums::new(spec.width_px);
        for measured in gathered.iter_mut() {
            let Ok(fit) = measured.fit else { continue };
            let reference = match &measured.reference {
                Some(reference) if reference.rate_rad_per_mm == fit.rate_rad_per_mm => reference.clone(),
                _ => Reference::straight(&fit, &spec.rope, measured.lines, spec.pitch_mm, spec.knot_lines),
            };
            let view = &mut measured.views[v];
            if view.image.lines() == 0 {
                continue;
            }
            if measured.reference.is_none() {
                view.set_axis(model, &spec.rope, &reference);
            }
            if view.usable() {
                let phase = |line: usize| model.camera.phase_in_view(reference.average_phase_rad(&spec.rope, line));
                let remover = reference.wires_remover(&spec.rope, model);
                sums.add(&spec.rope, &view.image, &view.axis_px, LINE_STRIDE, phase, remover);
            }
        }
        model.template = Template::new(&spec.rope, &model.camera, sums);
    }
}

fn wrong_hand(views: &Views) -> bool {
    let slants: Vec<f64> = views.models.iter().filter_map(|m| m.template.as_ref()).map(Template::slant).collect();
    slants.iter().sum::<f64>() > 0.0
}

/// Measures every stretch; `wires(k)` are those expected in stretch k.
fn measure_all(
    spec: &AlignerSpec,
    views: &mut Views,
    gathered: &mut [Measured],
    wires: &dyn Fn(usize) -> Vec<Option<WirePrediction>>,
) {
    for k in 0..gathered.len() {
        let (before, rest) = gathered.split_at_mut(k);
        let before: Vec<&Measured> = before.iter().rev().take(2).rev().collect();
        measure(spec, views, &mut rest[0], &before, &wires(k));
    }
}

/// Runs of consecutive stretches that were measured.
fn runs(gathered: &[Measured]) -> Vec<&[Measured]> {
    gathered.split(|m| m.reference.is_none()).filter(|run| !run.is_empty()).collect()
}

/// Knots over which residuals are looked at for what neighbours share.
const SHARED_KNOTS: usize = 12;

/// Factor on the stated variances that the residuals of measurements about their smoothed course ask for: their mean normalised
/// square, times how many neighbouring knots share one error (1 + twice the sum of autocorrelations).
fn residual_scale(series: &[Vec<Option<f64>>]) -> Option<f64> {
    let mut products = [(0.0, 0.0); SHARED_KNOTS + 1];
    for residuals in series {
        for (lag, product) in products.iter_mut().enumerate() {
            for (a, b) in residuals.iter().zip(residuals.iter().skip(lag)) {
                if let (Some(a), Some(b)) = (a, b) {
                    product.0 += a * b;
                    product.1 += 1.0;
                }
            }
        }
    }
    if products[0].1 < 50.0 {
        return None;
    }
    let covariance = |lag: usize| products[lag].0 / f64::max(products[lag].1, 1.0);
    let shared = 2.0 * (1..=SHARED_KNOTS).map(covariance).sum::<f64>();
    Some(covariance(0) + shared.max(0.0))
}

/// Residual of a measurement in standard deviations, given what the smoothed course says there and how well. `None` where the
/// course is little but this measurement.
fn normalised(measured: Measurement, expected_rad: f64, variance: f64) -> Option<f64> {
    let kept = 1.0 - measured.information * variance;
    // A defect here and there must not count: residuals are cut.
    let residual = measured.information.sqrt() * (measured.value_rad - expected_rad) / kept.max(0.2).sqrt();
    (measured.information > 0.0 && kept > 0.2).then_some(residual.clamp(-4.0, 4.0))
}

/// Scales the registration's variances by what the residuals about the smooth courses show.
fn calibrate_strands(spec: &AlignerSpec, views: &mut Views, gathered: &[Measured]) {
    let n = spec.rope.strands();
    for v in 0..views.models.len() {
        let mut series = Vec::new();
        for run in runs(gathered) {
            let window: Vec<&Measured> = run.iter().collect();
            let rate = run[0].reference.as_ref().map_or(0.0, |r| r.rate_rad_per_mm);
            let only: Vec<Vec<Measurement>> = run.iter().map(|m| m.strands.views[v].clone()).collect();
            for (j, course) in strand_courses(spec, &window, Some(v), rate).into_iter().enumerate() {
                if let Some(course) = course {
                    let knots = only.iter().flat_map(|f| f.chunks_exact(n).map(move |k| k[j])).enumerate();
                    series.push(
                        knots.map(|(k, m)| normalised(m, course.phase_rad(k), course.phase_variance(k))).collect(),
                    );
                }
            }
        }
        if let Some(scale) = residual_scale(&series) {
            // Residuals can show that the stated variances are too small, not that they are too large: what the template
            // and the wires' pattern share with the course, they hide.
            views.models[v].noise_scale = (views.models[v].noise_scale * scale).clamp(1.0, 50.0);
        }
    }
}

/// Searches the wires of every strand, tracks them through the gathered stretches, and learns where light shifts the stripes.
fn lock_wires(spec: &AlignerSpec, views: &mut Views, gathered: &mut [Measured]) -> Vec<Option<WirePrediction>> {
    let n = spec.rope.strands();
    let Some(first) = gathered.iter().position(|m| m.reference.is_some()) else { return vec![None; n] };
    let run = gathered[first..].iter().take_while(|m| m.reference.is_some()).count();
    let searched: Vec<&Measured> = gathered[first..first + run.min(WIRE_SEARCH_STRETCHES)].iter().collect();
    let mut start: Vec<Option<WirePrediction>> = {
        let views = &*views;
        (0..n).into_par_iter().map(|j| search_wires(spec, views, &searched, j)).collect()
    };
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
            wires = predict_wires(spec, &window, &wires);
        }
        if round == 0 && views.models.len() <= MOST_VIEWS_WITH_GAPS {
            let rates = recounted(spec, gathered, &start);
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
                let courses = joint_courses(spec, &window, None, rates);
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
                for (j, courses) in joint_courses(spec, &window, None, rates).into_iter().enumerate() {
                    if let (Some(strand), Some(wires)) = (courses.strand, courses.wires) {
                        let variances: Vec<(f64, f64)> =
                            (0..wires.len()).map(|k| (strand.phase_variance(k), wires.phase_variance(k))).collect();
                        for v in 0..views.models.len() {
                            let knots = run.iter().flat_map(|m| &m.wires[v][j]).enumerate();
                            let residual = |(k, knot): (usize, &WireKnot)| {
                                let share = knot.strand_share;
                                let expected = wires.phase_rad(k) + share * strand.phase_rad(k);
                                normalised(knot.joint(), expected, share * share * variances[k].0 + variances[k].1)
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

/// Up to so many views leave gaps in which nobody sees a strand.
const MOST_VIEWS_WITH_GAPS: usize = 2;

/// Wire rates of all strands over the gathered stretches, with the most plausible counts of wires between the passes.
fn recounted(spec: &AlignerSpec, gathered: &[Measured], start: &[Option<WirePrediction>]) -> Vec<Option<f64>> {
    let run = runs(gathered).into_iter().max_by_key(|run| run.len()).unwrap_or_default();
    let window: Vec<&Measured> = run.iter().collect();
    let Some(reference) = run.first().and_then(|m| m.reference.as_ref()) else { return vec![None; start.len()] };
    let courses = joint_courses(spec, &window, None, |j| start[j].map(|p| p.rate_rad_per_mm));
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
fn learn_patterns(spec: &AlignerSpec, views: &mut Views, gathered: &[Measured]) -> Vec<Vec<Option<WirePrediction>>> {
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
        let courses = joint_courses(spec, &window, None, |j| measured_rate(spec, measured, j));
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
            let knot = (reading * LINE_STRIDE / spec.knot_lines).min(grid.knots - 1);
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
