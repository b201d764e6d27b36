//! Joins what the views say of the rope's sideways position: one rope moves before all cameras.
//!
//! A camera at the angle a sees the rope's axis move by s (y cos a + z sin a), s being its scale, from where its optics put it.
//! Strands that lie higher or lower than others, dirt and badly lit edges move the contours of one view; what the views do not
//! have in common is therefore taken out of each, down to its usual value. The paper corrects every view by its own (eq. 9-10).

use super::camera::Camera;
use nalgebra::{DMatrix, DVector};

/// Difference between the views that is theirs, rms, as a share of the rope's width. More is movement: cameras that do not look at
/// the same place of the rope see it sway at different times.
const DISAGREEMENT: f64 = 0.002;
/// What a stretch leaves of the weight of those before it.
const FADING: f64 = 0.95;

/// Knows what each view's axis usually has beside the common movement, in px: how the camera was mounted.
#[derive(Debug, Clone, Default)]
pub struct SharedAxis {
    mounted_px: Vec<f64>,
    weight: f64,
}

impl SharedAxis {
    /// Takes what is not common out of the axes of a stretch, `axes_px[view][line]` as long as each other. `roughness_px` is how far
    /// each view's contours scatter about its own axis: smoother ones count more.
    pub fn join(&mut self, cameras: &[Camera], roughness_px: &[f64], width_px: f64, axes_px: &mut [&mut [f32]]) {
        let views = cameras.len();
        let lines = axes_px.first().map_or(0, |axis| axis.len());
        if lines == 0 || axes_px.iter().flat_map(|axis| axis.iter()).any(|px| !px.is_finite()) {
            return;
        }
        let axes = DMatrix::from_fn(views, lines, |view, line| f64::from(axes_px[view][line]));
        let mounted_px = not_common(cameras, &vec![1.0; views]) * axes.column_mean();
        let weight = FADING * self.weight + 1.0;
        self.mounted_px.resize(views, 0.0);
        for (mean, now) in self.mounted_px.iter_mut().zip(&mounted_px) {
            *mean += (now - *mean) / weight;
        }
        self.weight = weight;
        let moved = DMatrix::from_fn(views, lines, |view, line| axes[(view, line)] - self.mounted_px[view]);
        let apart = not_common(cameras, roughness_px) * moved;
        for (axis, apart) in axes_px.iter_mut().zip(apart.row_iter()) {
            let rms_px = (apart.norm_squared() / lines as f64).sqrt();
            let share = (DISAGREEMENT * width_px / rms_px.max(1e-9)).powi(2).min(1.0);
            axis.iter_mut().zip(apart.iter()).for_each(|(axis, px)| *axis -= (share * px) as f32);
        }
    }
}

/// The projection that leaves of all views' axes what no movement of the rope explains: I - A (sqrt(W) A)^+ sqrt(W). All zero where
/// the views do not overlap, as those of one camera or of two at right angles.
fn not_common(cameras: &[Camera], roughness_px: &[f64]) -> DMatrix<f64> {
    let movement = DMatrix::from_fn(cameras.len(), 2, |v, axis| {
        let (sin, cos) = cameras[v].angle_rad.sin_cos();
        cameras[v].px_per_mm * if axis == 0 { cos } else { sin }
    });
    let certainty = DMatrix::from_diagonal(&DVector::from_iterator(
        roughness_px.len(),
        roughness_px.iter().map(|rough| 1.0 / rough.max(0.1)),
    ));
    let inverse = (&certainty * &movement).pseudo_inverse(1e-9).unwrap_or_else(|_| DMatrix::zeros(2, cameras.len()));
    DMatrix::identity(cameras.len(), cameras.len()) - movement * inverse * certainty
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    const LINES: usize = 400;

    fn cameras(turns: &[f64]) -> Vec<Camera> {
        let camera = |turn| Camera { angle_rad: turn * FRAC_PI_2, distance_mm: 900.0, px_per_mm: 12.0 };
        turns.iter().map(|&turn| camera(turn)).collect()
    }

    /// Axes of a rope that sways, before cameras that are mounted a little askew; `own_px(view, line)` is added.
    fn axes(cameras: &[Camera], own_px: impl Fn(usize, usize) -> f64) -> Vec<Vec<f32>> {
        let axis = |v: usize, line: usize| {
            let (sin, cos) = cameras[v].angle_rad.sin_cos();
            let (y, z) = (0.3 * (line as f64 / 50.0).sin(), 0.2 * (line as f64 / 80.0).cos());
            240.0 + 3.0 * v as f64 + cameras[v].px_per_mm * (y * cos + z * sin) + own_px(v, line)
        };
        (0..cameras.len()).map(|v| (0..LINES).map(|line| axis(v, line) as f32).collect()).collect()
    }

    fn joined(cameras: &[Camera], roughness_px: &[f64], mut axes: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
        let mut slices: Vec<&mut [f32]> = axes.iter_mut().map(|axis| &mut axis[..]).collect();
        SharedAxis::default().join(cameras, roughness_px, 380.0, &mut slices);
        axes
    }

    /// Scatter of the difference of two axes about its mean.
    fn apart_px(a: &[f32], b: &[f32]) -> f64 {
        let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| f64::from(a - b)).collect();
        let mean = differences.iter().sum::<f64>() / differences.len() as f64;
        (differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / differences.len() as f64).sqrt()
    }

    #[test]
    fn what_a_rough_view_sees_alone_goes_and_the_common_movement_stays() {
        let cameras = cameras(&[0.0, 1.0, 2.0, 3.0]);
        let truth = axes(&cameras, |_, _| 0.0);
        let wavy = |v: usize, line: usize| if v == 0 { 0.6 * (line as f64 / 20.0).sin() } else { 0.0 };
        let seen = axes(&cameras, wavy);
        let before = apart_px(&seen[0], &truth[0]);
        let found = joined(&cameras, &[3.0, 1.0, 1.0, 1.0], seen);
        for (v, (found, truth)) in found.iter().zip(&truth).enumerate() {
            assert!(apart_px(found, truth) < 0.2 * before, "view {v}: {} of {before}", apart_px(found, truth));
        }
        let untouched = joined(&cameras, &[1.0; 4], truth.clone());
        for (found, truth) in untouched.iter().zip(&truth) {
            assert!(found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-3), "a rope that all views agree on");
        }
    }

    #[test]
    fn views_that_do_not_overlap_are_left_alone() {
        for turns in [&[0.0][..], &[0.0, 1.0]] {
            let cameras = cameras(turns);
            let seen = axes(&cameras, |v, line| (line % (40 + v)) as f64 / 60.0);
            assert_eq!(joined(&cameras, &vec![1.0; turns.len()], seen.clone()), seen);
        }
    }

    #[test]
    fn cameras_that_look_at_different_places_of_a_swaying_rope_are_left_alone() {
        let cameras = cameras(&[0.0, 2.0]);
        let seen = axes(&cameras, |v, line| if v == 0 { 10.0 * (line as f64 / 60.0).sin() } else { 0.0 });
        let found = joined(&cameras, &[1.0; 2], seen.clone());
        assert!(apart_px(&found[0], &seen[0]) < 0.2, "{}", apart_px(&found[0], &seen[0]));
    }
}
