//! The strands' rate by how alike the picture is to itself one strand further on.
//!
//! A photograph shows less than one lay: a handful of bumps in the contours, and the light eats at some of them. The whole
//! near side repeats with every strand, so the rate at which a mean over all strands explains the picture best is the rope's.

use super::aligner::AlignerSpec;
use super::measured::Measured;
use super::reference::Reference;
use super::registration::CUT;
use super::strand_alignment::StrandAlignment;
use super::stretch::{ViewModel, ViewStretch};
use super::template::{PhaseBin, Template, TemplateSums, normalised_line, phase_bin};

/// How far from the contours' rate is searched, as a share, and in how many steps to either side.
const SEARCHED: (f64, usize) = (0.1, 20);
/// Strands count up to this phase in view: farther out background, highlights and foreshortening disturb.
const NEAR_SIDE_RAD: f64 = 0.8;

/// The alignment with the rate that makes all strands look most alike. Unchanged where no rate within reach is the best.
pub(super) fn likest(
    spec: &AlignerSpec,
    models: &[ViewModel],
    measured: &mut Measured,
    fit: StrandAlignment,
) -> StrandAlignment {
    let (reach, steps) = SEARCHED;
    let rate = |s: f64| fit.rate_rad_per_mm * (1.0 + reach * (s / steps as f64 - 1.0));
    let unlike: Vec<f64> = (0..=2 * steps)
        .map(|s| {
            let fit = StrandAlignment { rate_rad_per_mm: rate(s as f64), ..fit };
            let course = Reference::straight(&fit, &spec.rope, measured.lines, spec.pitch_mm, spec.knot_lines);
            models.iter().zip(&mut measured.views).map(|(m, v)| unlikeness(spec, m, v, &course)).sum()
        })
        .collect();
    let Some(best) = (0..unlike.len()).min_by(|&a, &b| unlike[a].total_cmp(&unlike[b])) else { return fit };
    if best == 0 || best + 1 == unlike.len() {
        return fit; // an edge is never an answer
    }
    let (before, at, after) = (unlike[best - 1], unlike[best], unlike[best + 1]);
    let bend = before - 2.0 * at + after;
    let vertex = if bend > 0.0 { (before - after) / (2.0 * bend) } else { 0.0 };
    StrandAlignment { rate_rad_per_mm: rate(best as f64 + vertex), ..fit }
}

/// Mean square of what the mean over all strands leaves unexplained of a view.
fn unlikeness(spec: &AlignerSpec, model: &ViewModel, view: &mut ViewStretch, course: &Reference) -> f64 {
    if view.image.lines() == 0 {
        return 0.0;
    }
    view.set_axis(model, &spec.rope, course);
    if !view.usable() {
        return 0.0;
    }
    let phase = |line: usize| model.camera.phase_in_view(course.mean_phase_rad(line as f64));
    let mut sums = TemplateSums::new(spec.width_px);
    let as_it_is = |_: usize, _: PhaseBin, _: &mut [f32]| {};
    sums.add(&spec.rope, &view.image, &view.axis_px, spec.reading_lines, phase, as_it_is);
    let Some(template) = Template::new(&spec.rope, &model.camera, &sums) else { return 0.0 };
    let mut gray = vec![0.0; spec.width_px];
    let (mut squares, mut pixels) = (0.0, 0.0);
    for k in (0..view.image.lines()).step_by(spec.reading_lines) {
        if !normalised_line(view.image.line(k), view.axis_px[k], &mut gray) {
            continue;
        }
        let row = phase_bin(&spec.rope, phase(k)).row;
        for span in template.spans(row) {
            if span.phase_in_view_rad.abs() > NEAR_SIDE_RAD {
                continue;
            }
            let (from, to) = template.columns(span);
            let both = gray[from..to].iter().zip(&template.mean(row)[from..to]);
            let off = both.map(|(g, m)| f64::from((g - m).clamp(-CUT, CUT).powi(2)));
            squares += off.sum::<f64>();
            pixels += (to - from) as f64;
        }
    }
    squares / f64::max(pixels, 1.0)
}
