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
