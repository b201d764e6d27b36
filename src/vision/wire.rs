//! Centre line of a wire in its strand. [Wacker13, eq. 1 and 3]

use super::rope::Rope;
use super::strand::{StrandHelix, on_circle};
use std::f64::consts::TAU;

/// Parameters p_wj = (L_wj, o_wj) of the wires of one strand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WireHelix {
    /// Lay length L_wj in mm against the fixed axes, signed.
    pub lay_length_mm: f64,
    /// Phase offset o_wj in rad: phase of wire 0 at x = 0.
    pub offset_rad: f64,
}

impl WireHelix {
    /// Phase of wire `i` at `x_mm` in rad, against the fixed axes (eq. 3).
    pub fn phase_rad(&self, rope: &Rope, i: usize, x_mm: f64) -> f64 {
        x_mm * TAU / self.lay_length_mm + i as f64 * rope.wire_step_rad() + self.offset_rad
    }
}

/// Centre of wire `i` of strand `j` at `x_mm`: (x, y, z) in mm in rope axes (eq. 1).
pub fn wire_centre(
    rope: &Rope,
    strand: StrandHelix,
    wire: WireHelix,
    j: usize,
    i: usize,
    x_mm: f64,
) -> (f64, f64, f64) {
    let (y_s, z_s) = on_circle(rope.strand_curve_radius_mm(), strand.phase_rad(rope, j, x_mm));
    let (y_w, z_w) = on_circle(rope.wire_curve_radius_mm(), wire.phase_rad(rope, i, x_mm));
    (x_mm, y_s + y_w, z_s + z_w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::rope::RopeDesign;

    #[test]
    fn a_wire_stays_within_the_rope_and_reaches_its_surface() {
        let rope = RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap();
        let strand = StrandHelix { lay_length_mm: 220.0, offset_rad: 0.0 };
        let wire = WireHelix { lay_length_mm: -95.0, offset_rad: 0.0 };
        let farthest = (0..5000)
            .map(|k| wire_centre(&rope, strand, wire, 1, 2, k as f64))
            .map(|(_, y, z)| y.hypot(z) + rope.wire_radius_mm())
            .fold(0.0, f64::max);
        assert!((farthest - 16.0).abs() < 0.01, "{farthest}");
    }
}
