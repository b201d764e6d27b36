//! Finds a rope in a few gathered stretches: strands by their contours, then camera, template, each strand's course, wires.

use super::aligner::AlignerSpec;
use super::courses::strand_courses;
use super::first_views::{first_views, place_cameras};
use super::fitting::fit_from;
use super::measured::{Measured, Views};
use super::measuring::{Looking, measure};
use super::noise_scale::{normalised, residual_scale};
use super::reference::Reference;
use super::self_likeness::likest;
use super::smoothing::Measurement;
use super::stretch::ViewModel;
use super::template::{Template, TemplateSums};
use super::wire_lock::{learn_patterns, lock_wires};
use super::wire_prediction::WirePrediction;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Rounds of learning the wires' pattern, registration and template learning; each sharpens what the next one measures with.
const ROUNDS: usize = 2;

/// What a lock knows.
#[derive(Debug)]
pub(super) struct Lock {
    pub views: Views,
    pub wires: Vec<Option<WirePrediction>>,
}

/// Locks on the gathered stretches and measures them all. `None` if no stretch shows a rope; then every fit says why.
pub(super) fn lock(spec: &AlignerSpec, known: Option<Views>, gathered: &mut [Measured]) -> Option<Lock> {
    use Looking::{First, Last};
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
        sharpen(spec, &mut views, gathered);
        measure_all(spec, &mut views, gathered, &|_| unknown.clone(), First);
        first_templates(spec, &mut views, gathered);
        if spec.rope.design().strand_lay_mm.is_none() && wrong_hand(&views) {
            // The strands slant the other way: mirror the search. Contours alone could not tell.
            let lay = gathered.iter().find_map(|m| m.fit.ok()).map(|f| -TAU / f.rate_rad_per_mm)?;
            spec_now = spec.with_strand_lay(lay)?;
            fit_all(&spec_now, &views.models, gathered)?;
            sharpen(&spec_now, &mut views, gathered);
            views.models.iter_mut().for_each(|m| m.template = None);
            measure_all(spec, &mut views, gathered, &|_| unknown.clone(), First);
            first_templates(spec, &mut views, gathered);
        }
        // Contours alone had to tell so far.
        gathered.iter_mut().for_each(|measured| measured.reference = None);
        measure_all(spec, &mut views, gathered, &|_| unknown.clone(), First);
        first_templates(spec, &mut views, gathered);
        measure_all(spec, &mut views, gathered, &|_| unknown.clone(), First);
        lock_wires(spec, &mut views, gathered);
        // With the wires known, their pattern is learnt and taken out, and everything is measured again.
        for _ in 0..ROUNDS {
            let predictions = learn_patterns(spec, &mut views, gathered);
            measure_all(spec, &mut views, gathered, &|k| predictions[k].clone(), First);
            first_templates(spec, &mut views, gathered);
            calibrate_strands(spec, &mut views, gathered);
        }
        let predictions = learn_patterns(spec, &mut views, gathered);
        measure_all(spec, &mut views, gathered, &|k| predictions[k].clone(), Last);
        views.found_axis_px = (0..views.models.len()).map(|v| mean_axis_px(gathered, v)).collect();
    } else {
        measure_all(spec, &mut views, gathered, &|_| unknown.clone(), Last);
    }
    let wires = lock_wires(spec, &mut views, gathered);
    Some(Lock { views, wires })
}

/// Fits every stretch: the best on its own, the others outward from it. `None` if not one can be fitted.
fn fit_all(spec: &AlignerSpec, models: &[ViewModel], gathered: &mut [Measured]) -> Option<()> {
    let alone: Vec<_> = gathered.par_iter().map(|m| fit_from(spec, models, m, None)).collect();
    for (measured, fit) in gathered.iter_mut().zip(&alone) {
        measured.refit(*fit);
    }
    let score = |k: usize| alone[k].as_ref().map_or(f64::NEG_INFINITY, |f| f.score);
    let best = (0..gathered.len()).max_by(|&a, &b| score(a).total_cmp(&score(b)))?;
    alone[best].ok()?;
    let follow = |from: &Measured, to: &mut Measured| {
        if let Ok(fit) = from.fit {
            let reference = Reference::straight(&fit, &spec.rope, from.lines, spec.pitch_mm, spec.knot_lines);
            // Signed distance: stretches before the best one are reached backward.
            let shifted = reference_shifted(&reference, from.first_line, to.first_line);
            to.refit(fit_from(spec, models, to, Some((to.first_line, &shifted))));
        }
    };
    let (before, rest) = gathered.split_at_mut(best);
    let (best, after) = rest.split_first_mut()?;
    let outward = |stretches: &mut dyn Iterator<Item = &mut Measured>| {
        stretches.fold(&*best, |from, to| {
            follow(from, to);
            to
        });
    };
    rayon::join(|| outward(&mut after.iter_mut()), || outward(&mut before.iter_mut().rev()));
    Some(())
}

/// Contours of fewer strand lays than this leave the rate to the picture.
const FEW_LAYS: f64 = 1.5;
/// Contours whose rate is off the picture's by more than this share are not trusted,
const CONTRADICTION: f64 = 0.005;
/// and their variance is raised by this. A photograph, not taken line by line, shows edge and near side at different scales.
const CONTRADICTED_NOISE: f64 = 100.0;

/// Where hardly a lay was seen, takes the rate from the picture.
fn sharpen(spec: &AlignerSpec, views: &mut Views, gathered: &mut [Measured]) {
    let lays = |m: &Measured| m.fit.map_or(0.0, |f| f.rate_rad_per_mm.abs() / TAU * m.lines as f64 * spec.pitch_mm);
    if gathered.iter().map(lays).sum::<f64>() >= FEW_LAYS {
        return;
    }
    for measured in gathered {
        let Ok(fit) = measured.fit else { continue };
        let likest = likest(spec, &views.models, measured, fit);
        measured.refit(Ok(likest));
        if (likest.rate_rad_per_mm / fit.rate_rad_per_mm - 1.0).abs() > CONTRADICTION {
            views.models.iter_mut().for_each(|m| m.contour_noise_scale = CONTRADICTED_NOISE);
        }
    }
}

/// Mean column of the rope axis in a view; NaN if it never shows the rope.
fn mean_axis_px(gathered: &[Measured], view: usize) -> f64 {
    let usable = gathered.iter().map(|measured| &measured.views[view]).filter(|view| view.usable());
    let columns = usable.flat_map(|view| view.axis_px.iter().map(|&px| f64::from(px)));
    let (sum, lines) = columns.fold((0.0, 0.0), |(sum, lines), px| (sum + px, lines + 1.0));
    sum / lines
}

/// The same straight course, with lines counted from another first line.
fn reference_shifted(reference: &Reference, from_line: usize, to_line: usize) -> Reference {
    let lines = to_line as f64 - from_line as f64;
    Reference {
        phase_rad: reference.phase_rad + reference.rate_rad_per_mm * lines * reference.pitch_mm,
        ..reference.clone()
    }
}

/// Learns the templates anew from all gathered stretches.
fn first_templates(spec: &AlignerSpec, views: &mut Views, gathered: &mut [Measured]) {
    let references: Vec<Option<Reference>> = gathered
        .iter()
        .map(|measured| {
            let fit = measured.fit.ok()?;
            let straight = || Reference::straight(&fit, &spec.rope, measured.lines, spec.pitch_mm, spec.knot_lines);
            Some(measured.reference.clone().unwrap_or_else(straight))
        })
        .collect();
    for (measured, reference) in gathered.iter_mut().zip(&references).filter(|(m, _)| m.reference.is_none()) {
        let Some(reference) = reference else { continue };
        measured.views.par_iter_mut().zip(&views.models).filter(|(view, _)| view.image.lines() > 0).for_each(
            |(view, model)| {
                view.set_axis(model, &spec.rope, reference);
            },
        );
    }
    views.models.par_iter_mut().zip(&mut views.sums).enumerate().for_each(|(v, (model, sums))| {
        *sums = TemplateSums::new(spec.width_px);
        for (measured, reference) in gathered.iter().zip(&references) {
            let (view, Some(reference)) = (&measured.views[v], reference) else { continue };
            if view.image.lines() > 0 && view.usable() {
                let phase = |line: usize| model.camera.phase_in_view(reference.average_phase_rad(&spec.rope, line));
                let remover = reference.wires_remover(&spec.rope, model);
                sums.add(&spec.rope, &view.image, &view.axis_px, spec.reading_lines, phase, remover);
            }
        }
        model.template = Template::new(&spec.rope, &model.camera, sums);
    });
}

fn wrong_hand(views: &Views) -> bool {
    let slants: Vec<f64> = views.models.iter().filter_map(|m| m.template.as_ref()).map(Template::slant).collect();
    slants.iter().sum::<f64>() > 0.0
}

/// Measures every stretch, `looking` so closely; `wires(k)` are those expected in stretch k.
fn measure_all(
    spec: &AlignerSpec,
    views: &mut Views,
    gathered: &mut [Measured],
    wires: &dyn Fn(usize) -> Vec<Option<WirePrediction>>,
    looking: Looking,
) {
    for k in 0..gathered.len() {
        let (before, rest) = gathered.split_at_mut(k);
        let before: Vec<&Measured> = before.iter().rev().take(2).rev().collect();
        measure(spec, views, &mut rest[0], &before, &wires(k), looking);
    }
}

/// Runs of consecutive stretches that were measured.
pub(super) fn runs(gathered: &[Measured]) -> Vec<&[Measured]> {
    gathered.split(|m| m.reference.is_none()).filter(|run| !run.is_empty()).collect()
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
                    let variances = course.phase_variances();
                    series.push(knots.map(|(k, m)| normalised(m, course.phase_rad(k), variances[k])).collect());
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
