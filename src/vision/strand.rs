//! Centre line of a strand. [Wacker13, eq. 1-2]

use super::rope::Rope;
use std::f64::consts::TAU;

/// Parameters p_s = (L_s, o_s) of all strands of a rope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrandHelix {
    /// Lay length L_s in mm, signed (+ right-hand).
    pub lay_length_mm: f64,
    /// Phase offset o_s in rad: phase of strand 0 at x = 0.
    pub offset_rad: f64,
}

impl StrandHelix {
    /// Phase of strand `j` at `x_mm` in rad (eq. 2).
    pub fn phase_rad(&self, rope: &Rope, j: usize, x_mm: f64) -> f64 {
        x_mm * TAU / self.lay_length_mm + j as f64 * rope.strand_step_rad() + self.offset_rad
    }
}

/// A point (y, z) in mm on a circle of `radius_mm` at `phase_rad`: the cross-section part of eq. 1.
///
/// Axes: y = r sin(phase), z = -r cos(phase); the camera of view 0 looks along +z, so phase 0 is nearest to it.
pub fn on_circle(radius_mm: f64, phase_rad: f64) -> (f64, f64) {
    (radius_mm * phase_rad.sin(), -radius_mm * phase_rad.cos())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::rope::RopeDesign;

    #[test]
    fn a_strand_is_back_at_its_phase_after_one_lay() {
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
        let helix = StrandHelix { lay_length_mm: -137.5, offset_rad: 0.3 };
        let turned = helix.phase_rad(&rope, 2, 137.5) - helix.phase_rad(&rope, 2, 0.0);
        assert!((turned + TAU).abs() < 1e-12); // left-hand: the phase falls
        let (y, z) = on_circle(2.0, std::f64::consts::FRAC_PI_2);
        assert!((y - 2.0).abs() < 1e-12 && z.abs() < 1e-12);
    }
}
