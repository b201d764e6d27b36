//! Distance from the camera to the rope axis, from the contours of an acquisition. [Wacker13, sec. 3.2-3.3: d]
//!
//! A near camera sees the outline of a strand before the strand stands at the side: upper and lower contour are shifted against
//! each other along the rope, the more the nearer the camera stands. The paper optimises d together with the other parameters;
//! here the shift itself is measured, as the phase between the strand harmonics of both contours, which nothing else changes.

use super::camera::Camera;
use super::contour::Contours;
use super::model_contour::ModelContour;
use super::rope::Rope;
use super::unwrapping::peak;

/// Nearest and farthest distances that are considered, in rope diameters.
pub const DISTANCE_DIAMETERS: (f64, f64) = (3.0, 200.0);
/// Distance that is assumed where the contours tell nothing, in rope diameters.
pub const DEFAULT_DISTANCE_DIAMETERS: f64 = 12.0;

/// Strand harmonics of both contours of a view: complex sums that stretches add up to.
#[derive(Debug, Clone, Copy, Default)]
pub struct ContourHarmonics {
    upper: (f64, f64),
    lower: (f64, f64),
}

impl ContourHarmonics {
    /// Adds the contours of a stretch; `phase_in_view_rad(line)` is that of any strand, `period_lines` the period of the outline.
    pub fn add(
        &mut self,
        strands: usize,
        contours: &Contours,
        period_lines: usize,
        phase_in_view_rad: impl Fn(usize) -> f64,
    ) {
        let n = contours.len();
        // Whole periods only, with their own mean taken out twice: slow sideways movement must not leak in.
        let mut from = 0;
        while from + 2 * period_lines <= n {
            let line = |k: usize| (f64::from(contours.lower_px[k]), f64::from(contours.upper_px[k]));
            for k in from + period_lines / 2..from + period_lines + period_lines / 2 {
                let (before, after) = (k - period_lines / 2, k + period_lines / 2);
                let ((l, u), (lb, ub), (la, ua)) = (line(k), line(before), line(after));
                let (du, dl) = (u - (ub + ua) / 2.0, l - (lb + la) / 2.0);
                if !(du.is_finite() && dl.is_finite()) || du.abs() > 60.0 || dl.abs() > 60.0 {
                    continue;
                }
                let (sin, cos) = (strands as f64 * phase_in_view_rad(k)).sin_cos();
                self.upper.0 += du * cos;
                self.upper.1 -= du * sin;
                self.lower.0 += dl * cos;
                self.lower.1 -= dl * sin;
            }
            from += period_lines;
        }
    }

    /// upper * conj(lower): its angle is the shift between the contours.
    fn cross(&self) -> (f64, f64) {
        let ((a, b), (c, d)) = (self.upper, self.lower);
        (a * c + b * d, b * c - a * d)
    }
}

fn model_cross(rope: &Rope, camera: &Camera) -> (f64, f64) {
    let model = ModelContour::new(rope, camera);
    let mut harmonics = ContourHarmonics::default();
    const SAMPLES: usize = 256;
    for k in 0..SAMPLES {
        let phase = rope.strand_step_rad() * k as f64 / SAMPLES as f64;
        let (sin, cos) = (rope.strands() as f64 * phase).sin_cos();
        let (lower, upper) = model.edges_px(phase);
        harmonics.upper.0 += upper * cos;
        harmonics.upper.1 -= upper * sin;
        harmonics.lower.0 += lower * cos;
        harmonics.lower.1 -= lower * sin;
    }
    harmonics.cross()
}

/// The distance in mm that explains the shift of all views best. `None` if the answer lies at the edge of what is considered.
pub fn estimate(rope: &Rope, views: &[ContourHarmonics]) -> Option<f64> {
    let crosses: Vec<(f64, f64)> = views.iter().map(ContourHarmonics::cross).collect();
    let agreement = |inverse_mm: f64| {
        let (a, b) = model_cross(rope, &Camera { angle_rad: 0.0, distance_mm: 1.0 / inverse_mm, px_per_mm: 10.0 });
        let norm = a.hypot(b);
        crosses.iter().map(|(c, d)| (a * c + b * d) / norm).sum::<f64>()
    };
    let nearest = 1.0 / (DISTANCE_DIAMETERS.0 * rope.diameter_mm());
    let farthest = 1.0 / (DISTANCE_DIAMETERS.1 * rope.diameter_mm());
    const GRID: usize = 30;
    let at = |k: usize| farthest + (nearest - farthest) * k as f64 / GRID as f64;
    let (best, _) = (0..=GRID).map(|k| (k, agreement(at(k)))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    if best == 0 || best == GRID {
        return None;
    }
    Some(1.0 / peak(&agreement, at(best - 1), at(best + 1)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::rope::RopeDesign;

    #[test]
    fn finds_the_distance_of_noisy_contours() {
        let rope = RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 20.46,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap();
        for distance_mm in [150.0, 300.0, 600.0] {
            let model = ModelContour::new(&rope, &Camera { angle_rad: 0.0, distance_mm, px_per_mm: 18.0 });
            let mut contours = Contours::default();
            let phase = |k: usize| k as f64 * 0.00457 + 0.2;
            for k in 0..8000 {
                let noise = ((k * 7919 % 101) as f64 / 50.0 - 1.0, (k * 104_729 % 101) as f64 / 50.0 - 1.0);
                let sway = 5.0 * (k as f64 / 500.0).sin();
                contours.lower_px.push((240.0 + sway + model.edge_px(1, phase(k)) + noise.0) as f32);
                contours.upper_px.push((240.0 + sway + model.edge_px(0, phase(k)) + noise.1) as f32);
            }
            let mut harmonics = ContourHarmonics::default();
            harmonics.add(6, &contours, 229, phase);
            let found = estimate(&rope, &[harmonics]).unwrap();
            assert!((found / distance_mm - 1.0).abs() < 0.05, "{found} for {distance_mm}");
        }
    }
}
