//! The Cramer-Rao bounds of a trial: of its own rope, phases, lays and noise. All as mean |error| in mm, as errors are reported.

use super::super::ExperimentError;
use super::super::frames::SceneFrames;
use super::super::trial::Trial;
use crate::evaluate::bound::{
    Drift, GrayNoise, ImageBound, KnownLine, SeenRope, contour_bound_mm, image_bound, mean_abs, sequence_bound_mm,
};
use crate::evaluate::lay_lengths::ScoredStretch;
use crate::pipeline::FrameSource;
use crate::simulate::truth::WIRE_ROW_LINES;
use crate::simulate::{Kind, Recipe, Scene};
use std::f64::consts::TAU;

/// Lines of which one is looked at for the bound of an image; a multiple of the rows of the wires' truth.
const IMAGE_STRIDE: usize = 2 * WIRE_ROW_LINES;
/// Gray level at which the variance of the photographic kind's noise has doubled.
const SHOT_GRAY: f64 = 40.0;
/// Variance of the simulator's drift as a share of its reach squared: four waves whose weights lie between 0.3 and 1.3.
const DRIFT_VARIANCE: f64 = 0.137;
/// Stretches that our smoother joins: the one that it answers and its neighbours.
pub(super) const JOINED: usize = 3;

/// The rope of a recipe as the bounds see it.
pub(super) fn seen_rope(recipe: &Recipe) -> SeenRope {
    let Recipe { strands, wires_per_strand, diameter_mm, rope_width_px, camera_distance_mm, .. } = *recipe;
    SeenRope::new(strands, wires_per_strand, diameter_mm, rope_width_px, camera_distance_mm)
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (n, sum) = values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v * v));
    (n > 0.0).then(|| (sum / n).sqrt())
}

/// Frame by frame, from the contours of one view with the noise of the recipe.
pub(super) fn frame_wise_mm(scene: &Scene, trial: &Trial) -> Option<f64> {
    let (rope, recipe) = (seen_rope(scene.recipe()), scene.recipe());
    let of = |stretch: &ScoredStretch| {
        let middle_rad = trial.truth.phase_rad[(stretch.first_line + stretch.last_line) / 2] - scene.view_angle_rad(0);
        let frame = (stretch.last_line - stretch.first_line + 1, recipe.line_pitch_mm);
        Some(contour_bound_mm(&rope, stretch.strand?.true_mm, middle_rad, frame, recipe.contour_noise_px))
    };
    root_mean_square(trial.stretches.iter().filter_map(of)).map(mean_abs)
}

/// Of a smoother that joins `stretches` of `lines` and knows how lays drift in the recipe, from the same contours.
pub(super) fn smoothed_mm(recipe: &Recipe, stretches: usize, lines: usize) -> Option<f64> {
    let (lay_mm, drift_mm) = (recipe.strand_lay_mm.abs(), recipe.strand_lay_drift_mm);
    let reach = (TAU / (lay_mm - drift_mm) - TAU / (lay_mm + drift_mm)) / 2.0;
    let waves_mm = (recipe.drift_wave_m * 1e3, recipe.drift_wave_m * 1e4);
    let drift = Drift { rate_sd: DRIFT_VARIANCE.sqrt() * reach, waves_mm };
    let frames = (stretches, lines);
    sequence_bound_mm(&seen_rope(recipe), lay_mm, frames, recipe.line_pitch_mm, recipe.contour_noise_px, drift)
        .map(mean_abs)
}

/// Of one stretch from everything that view 0 shows: gray values with the recipe's noise and, where the protocol gives them, the
/// contours. Standard deviations.
pub(super) fn image(
    scene: &Scene,
    trial: &Trial,
    stretch: &ScoredStretch,
) -> Result<Option<ImageBound>, ExperimentError> {
    let recipe = scene.recipe();
    let quiet = Scene::new(&Recipe { gray_noise: 0.0, ..recipe.clone() }, scene.seed())?;
    let source = SceneFrames(&quiet);
    let (Some(strand), Some(wires)) = (stretch.strand, &trial.truth.wires) else { return Ok(None) };
    let mut frame = None;
    let mut lines = Vec::new();
    let first = stretch.first_line.next_multiple_of(IMAGE_STRIDE);
    for line in (first..stretch.last_line).step_by(IMAGE_STRIDE) {
        let number = line / recipe.frame_lines;
        if frame.as_ref().is_none_or(|(n, _)| *n != number) {
            frame = Some((number, source.load(0, number).map_err(crate::pipeline::PipelineError::from)?));
        }
        let Some((_, pixels)) = &frame else { break };
        let row = (line - scene.first_line(number)) * pixels.width;
        let view_rad = scene.view_angle_rad(0);
        lines.push(KnownLine {
            x_mm: line as f64 * recipe.line_pitch_mm,
            axis_px: scene.camera().axis_px + scene.displacement_px(line, 0),
            strand_rad: trial.truth.phase_rad[line] - view_rad,
            wire_rad: wires.phase_rad.iter().map(|of| of[line / WIRE_ROW_LINES] - view_rad).collect(),
            gray: pixels.pixels[row..row + pixels.width].iter().map(|&g| f64::from(g)).collect(),
        });
    }
    let wire_lay_mm = root_mean_square(stretch.wires.iter().flatten().map(|w| w.true_mm));
    let lays_mm = (strand.true_mm, wire_lay_mm.unwrap_or(recipe.wire_lay_mm));
    let (doubles_at, contours_px) = match recipe.kind {
        Kind::Artificial => (f64::INFINITY, Some(recipe.contour_noise_px)),
        Kind::Photographic => (SHOT_GRAY, None),
    };
    let noise = GrayNoise { sd: recipe.gray_noise, doubles_at };
    Ok(image_bound(&seen_rope(recipe), &lines, IMAGE_STRIDE as f64, lays_mm, noise, contours_px))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::curve::SmoothCurve;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_drift_of_the_simulator_has_the_variance_that_the_bound_assumes() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let squares: f64 =
            (0..8000).map(|_| SmoothCurve::waves(&mut rng, 0.0, 1.0, 6e3..6e4, 4).value(500.0).powi(2)).sum();
        let variance = squares / 8000.0;
        assert!((variance / DRIFT_VARIANCE - 1.0).abs() < 0.06, "{variance}"); // four standard errors
    }
}
