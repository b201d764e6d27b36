//! Measures strands and wires of a stretch knot by knot, and learns from it how the rope looks.

use super::aligner::AlignerSpec;
use super::camera::Camera;
use super::course::Course;
use super::courses::{StrandCourses, strand_courses, with};
use super::measured::{Measured, Views};
use super::outline_detail::OutlineDetail;
use super::reference::Reference;
use super::registration::KnotSums;
use super::shade::Shade;
use super::stretch::{FARTHEST_STEP_RAD, ViewStretch, register_views, strand_knots};
use super::unwrapping::{self, Stripes, read_stripes};
use super::wire_lock::{LEAST_COHERENCE, search_wires};
use super::wire_pattern::WirePattern;
use super::wire_prediction::WirePrediction;
use super::wire_tracking::{WireKnot, readings, wire_knots};
use rayon::prelude::*;

/// Where deviations are only found to start from, one of so many lines is looked at,
const THINNED: usize = 2;
/// in so many rounds. Measured: with one, strand lays are a tenth less exact at a gray noise of 40 and as exact at 10.
const THINNED_ROUNDS: usize = 2;

/// How closely a stretch is looked at. Measured: lays come out the same if only the last look is at all lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Looking {
    /// At thinned lines: it will be measured again, starting from what is found.
    First,
    /// At all lines in the end.
    Last,
}

/// Farthest that a strand is taken to be from the straight course.
const FARTHEST_RAD: f64 = 2.0 * FARTHEST_STEP_RAD;

/// Measures each strand's course through a stretch by registration, `looking` so closely, thinned rounds first: from what was measured before with the same fit,
/// if anything was, else from the straight course of the fit.
///
/// `wires` are where the wires are expected; their pattern is taken out of the image where it is known.
pub(super) fn measure(
    spec: &AlignerSpec,
    views: &mut Views,
    seen: &mut Measured,
    before: &[&Measured],
    wires: &[Option<WirePrediction>],
    looking: Looking,
) {
    let Ok(fit) = seen.fit else { return };
    let rope = &spec.rope;
    let mut reference = Reference::straight(&fit, rope, seen.lines, spec.pitch_mm, spec.knot_lines);
    let middle_mm = (seen.first_line as f64 + (seen.lines as f64 - 1.0) / 2.0) * spec.pitch_mm;
    for (wire, prediction) in reference.wires.iter_mut().zip(wires) {
        if let Some(prediction) = prediction {
            *wire = (prediction.at(middle_mm), prediction.rate_rad_per_mm);
        }
    }
    seen.views.par_iter_mut().zip(&views.models).for_each(|(view, model)| {
        if view.shows_edges() {
            view.set_axis(model, rope, &reference);
        }
    });
    join_axes(views, seen);
    if let Some(measured) = seen.reference.take() {
        reference.deviation_rad = measured.deviation_rad;
    }
    let mut sums = Vec::new();
    for _ in 0..THINNED_ROUNDS {
        sums = follow_strands(spec, views, seen, before, &mut reference, THINNED);
    }
    if looking == Looking::Last {
        sums = follow_strands(spec, views, seen, before, &mut reference, 1);
    }
    // Now that strands and wires are about where they stand, the image tells where the axis is.
    let registered = seen.views.iter_mut().zip(&sums).filter(|(view, _)| view.usable());
    registered.for_each(|(view, sums)| view.refine_axis(sums));
    join_axes(views, seen);
    seen.reference = Some(reference);
}

/// A round of registration, one of `thinned` lines looked at: measures the strands and moves the reference to their courses. Answers the
/// normal equations of every view.
fn follow_strands(
    spec: &AlignerSpec,
    views: &Views,
    seen: &mut Measured,
    before: &[&Measured],
    reference: &mut Reference,
    thinned: usize,
) -> Vec<Vec<KnotSums>> {
    let (rope, n, knots) = (&spec.rope, spec.rope.strands(), reference.knots());
    let sums = register_views(rope, &views.models, &seen.views, reference, thinned);
    seen.strands = strand_knots(rope, &views.models, &sums, reference);
    if sums.iter().all(Vec::is_empty) {
        return sums;
    }
    let courses = strand_courses(spec, &with(before, seen), None, reference.rate_rad_per_mm);
    for k in 0..knots {
        let mean = reference.mean_phase_rad(reference.knot_middle(k));
        for (j, course) in courses.iter().enumerate() {
            let phase = |course: &Course| course.phase_rad(course.len() - knots + k);
            let straight = mean + j as f64 * rope.strand_step_rad();
            let deviation = course.as_ref().map_or(0.0, |course| phase(course) - straight);
            reference.deviation_rad[k * n + j] = deviation.clamp(-FARTHEST_RAD, FARTHEST_RAD);
        }
    }
    sums
}

/// Lets the axes of all views follow one rope, if every view shows it.
fn join_axes(views: &mut Views, seen: &mut Measured) {
    if seen.views.iter().all(ViewStretch::usable) {
        let cameras: Vec<Camera> = views.models.iter().map(|model| model.camera).collect();
        let roughness_px: Vec<f64> = seen.views.iter().map(|view| view.axis_roughness_px).collect();
        let width_px = views.models.iter().map(|model| model.contour.mean_width_px()).fold(0.0, f64::max);
        let mut axes_px: Vec<&mut [f32]> = seen.views.iter_mut().map(|view| &mut view.axis_px[..]).collect();
        views.shared_axis.join(&cameras, &roughness_px, width_px, &mut axes_px);
    }
}

/// Reads the wires' stripes of a stretch whose strands were measured; `wires` are where the wires are expected, as far as that is known.
pub(super) fn read_wires(spec: &AlignerSpec, views: &Views, seen: &mut Measured, wires: &[Option<WirePrediction>]) {
    let Some(reference) = &seen.reference else { return };
    let known: Vec<f64> = wires.iter().flatten().map(|wire| wire.rate_rad_per_mm.abs()).collect();
    let wire_rate =
        (!known.is_empty() && spec.sees_all_round()).then(|| known.iter().sum::<f64>() / known.len() as f64);
    let wire_turns = wire_rate.map(|rate| rate / reference.rate_rad_per_mm);
    seen.stripes = views
        .models
        .par_iter()
        .zip(&seen.views)
        .map(|(model, view)| match (&model.template, view.usable()) {
            (Some(template), true) => {
                let phases = |line: usize, out: &mut [f64]| reference.phases_rad(&spec.rope, line, out);
                let shade = Shade::new(&spec.rope, template, wire_turns, unwrapping::FARTHEST_RAD);
                let (outlines, table) = (&model.outlines, &views.table);
                read_stripes(&spec.rope, outlines, &shade, table, &view.image, &view.axis_px, phases)
            }
            _ => Stripes::default(),
        })
        .collect();
}

/// Adds a measured stretch to the templates and renews them.
pub(super) fn learn_template(spec: &AlignerSpec, views: &mut Views, seen: &Measured) {
    let Some(reference) = &seen.reference else { return };
    let rope = &spec.rope;
    views.models.par_iter_mut().zip(&mut views.sums).zip(&seen.views).for_each(|((model, sums), view)| {
        if view.usable() {
            sums.fade(0.9);
            let angle = model.camera.angle_rad;
            let phase = |line: usize| reference.average_phase_rad(rope, line) - angle;
            let (stride, remover) = (2 * spec.reading_lines, reference.wires_remover(rope, model));
            sums.add(rope, &view.image, &view.axis_px, stride, phase, remover);
            if let Some(template) = super::template::Template::new(rope, &model.camera, sums) {
                model.template = Some(template);
            }
        }
    });
}

/// Adds a stretch whose wires were measured to the wire patterns.
pub(super) fn learn_pattern(
    spec: &AlignerSpec,
    views: &mut Views,
    seen: &Measured,
    courses: &[StrandCourses],
    first_knot: usize,
) {
    let Some(reference) = &seen.reference else { return };
    let grid = seen.grid(spec);
    let wires_at = |line: usize, out: &mut [f64]| {
        let knot = (line / spec.knot_lines).min(grid.knots - 1);
        let off_mm = (seen.first_line + line) as f64 * spec.pitch_mm - grid.knot_mm(knot);
        for (phase, course) in out.iter_mut().zip(courses) {
            let at = first_knot + knot;
            *phase = course.wires.as_ref().map_or(f64::NAN, |c| c.phase_rad(at) + c.rate_rad_per_mm(at) * off_mm);
        }
    };
    let phases = |line: usize, strands: &mut [f64], wires: &mut [f64]| {
        reference.phases_rad(&spec.rope, line, strands);
        wires_at(line, wires);
    };
    let sums = views.detail_sums.par_iter_mut().zip(&mut views.pattern_sums);
    views.models.par_iter().zip(sums).zip(&seen.views).filter(|(_, view)| view.usable()).for_each(
        |((model, (detail, pattern)), view)| {
            let angle_rad = model.camera.angle_rad;
            detail.add(&spec.rope, &model.contour, angle_rad, &view.contours, &view.axis_px, phases);
            if let Some(template) = &model.template {
                let stride = spec.reading_lines;
                pattern.add(&spec.rope, template, angle_rad, &view.image, &view.axis_px, stride, phases);
            }
        },
    );
}

/// Renews the wire patterns from what was learnt.
pub(super) fn renew_patterns(spec: &AlignerSpec, views: &mut Views) {
    let sums = views.pattern_sums.par_iter().zip(&views.detail_sums);
    views.models.par_iter_mut().zip(sums).for_each(|(model, (sums, detail))| {
        model.detail = OutlineDetail::new(&spec.rope, &model.contour, detail);
        model.pattern = model.template.as_ref().map(|template| WirePattern::new(&spec.rope, template, sums));
    });
}

/// Measures the wires of a stretch in every view, relative to what is predicted of them; where the prediction proves wrong, the
/// wires of that strand are searched anew.
pub(super) fn measure_wires(spec: &AlignerSpec, views: &Views, seen: &mut Measured, wires: &[Option<WirePrediction>]) {
    let grid = seen.grid(spec);
    let stripes: Vec<_> = seen.stripes.iter().zip(&views.shifts).collect();
    let seen_now = &*seen;
    let predictions: Vec<Option<WirePrediction>> = (0..spec.rope.strands())
        .into_par_iter()
        .map(|j| {
            let readings = readings(&spec.rope, &stripes, j, grid);
            let adapted = wires[j].map(|p| p.adapted(spec.rope.wires(), &readings));
            match adapted {
                Some((prediction, coherence)) if coherence >= LEAST_COHERENCE || readings.len() < 16 => {
                    Some(prediction)
                }
                _ => search_wires(spec, views, &[seen_now], j),
            }
        })
        .collect();
    let Some(reference) = &seen.reference else { return };
    seen.wires = stripes
        .par_iter()
        .zip(&views.models)
        .map(|((stripes, shift), model)| {
            (0..spec.rope.strands())
                .map(|j| match predictions[j] {
                    Some(prediction) => {
                        let strand = |knot| reference.strand_rad(&spec.rope, knot, j);
                        let (scale, angle) = (views.wire_noise_scale, model.camera.angle_rad);
                        wire_knots(&spec.rope, stripes, shift, j, grid, prediction, scale, strand, angle)
                    }
                    None => vec![WireKnot::default(); grid.knots],
                })
                .collect()
        })
        .collect();
}
