//! The ArtificialRope: each wire a Gaussian across its projected centre line, each strand's outline analytic.
//! [Wacker13, sec. 3.2, eq. 4-8, sec. 6.1]

use super::cross_section::CrossSection;
use super::noise::{GaussianStream, Stream};
use super::scene::Scene;

/// Gray level of the background.
const DARK: f32 = 10.0;
/// Gray level of a centre line over the background.
const CONTRAST: f32 = 235.0;
/// sd of the Gaussian in wire radii. The paper says only that the mask is as wide as the wire.
const SD_WIRE_RADII: f64 = 0.62;

/// Renders one frame. Nearer wires cover what is behind them.
pub fn render(scene: &Scene, view: usize, frame: usize) -> Vec<u8> {
    let (rope, camera, recipe) = (scene.rope(), scene.camera(), scene.recipe());
    let width = recipe.sensor_px as usize;
    let height = scene.frame_height(frame);
    let mut pixels = vec![0; width * height];
    let mut noise = GaussianStream::new(scene.seed(), Stream::Frame { view, frame });
    let mut cut = CrossSection::default();
    let mut nearest = vec![(f64::INFINITY, DARK); width];
    let sd = recipe.gray_noise as f32;
    for (row, pixels) in pixels.chunks_exact_mut(width).enumerate() {
        cut.cut(scene, view, scene.first_line(frame) + row, &[]);
        nearest.fill((f64::INFINITY, DARK));
        for wire in &cut.wires {
            let centre_px = camera.column_px(wire.y, wire.z); // eq. 5
            let radius_px = camera.focal_px * rope.wire_radius_mm() / (wire.z + camera.distance_mm);
            let first = (centre_px - radius_px).ceil().max(0.0) as usize;
            let end = ((centre_px + radius_px).floor() + 1.0).clamp(0.0, width as f64) as usize;
            for (column, nearest) in nearest.iter_mut().enumerate().take(end).skip(first) {
                if wire.z < nearest.0 {
                    let u = (column as f64 - centre_px) / (SD_WIRE_RADII * radius_px);
                    *nearest = (wire.z, DARK + CONTRAST * (-0.5 * u * u).exp() as f32);
                }
            }
        }
        for (pixel, (_, gray)) in pixels.iter_mut().zip(&nearest) {
            *pixel = (gray + sd * noise.draw() + 0.5).clamp(0.0, 255.0) as u8;
        }
    }
    pixels
}

/// The volumetric contours of a line in px, lower and upper: the outermost strand outlines. [Wacker13, eq. 6-8]
pub fn contours_px(scene: &Scene, cut: &CrossSection) -> (f64, f64) {
    let (camera, radius_mm) = (scene.camera(), scene.rope().strand_radius_mm());
    cut.strands
        .iter()
        .map(|s| camera.outline_px(s.y, s.z, radius_mm))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Recipe;

    #[test]
    fn contours_reach_the_ropes_width_and_never_leave_it() {
        let scene = Scene::new(&Recipe::artificial(), 8).unwrap();
        let mut cut = CrossSection::default();
        let mut widest = 0.0_f64;
        for line in (0..20_000).step_by(20) {
            cut.cut(&scene, 0, line, &[]);
            let (low, high) = contours_px(&scene, &cut);
            assert!(low > 49.49 && high < 429.51, "{low} {high}");
            widest = widest.max(high - low);
        }
        assert!(widest > 375.0, "{widest}");
    }
}
