//! The rope as a line camera sees it: outlines, wires, and how far both move when a strand or a wire turns.

use std::f64::consts::PI;

/// A rope before a camera. The first strand's phase is 0 where it is nearest to the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenRope {
    /// Number of strands.
    pub strands: usize,
    /// Wires of a strand.
    pub wires: usize,
    /// Radius of the strands' centre lines in mm, r_s.
    pub strand_curve_mm: f64,
    /// Radius of a strand in mm.
    pub strand_radius_mm: f64,
    /// Radius of the wires' centre lines about the strand's in mm, r_w.
    pub wire_curve_mm: f64,
    /// Radius of a wire in mm.
    pub wire_radius_mm: f64,
    /// Camera to rope axis in mm, d.
    pub distance_mm: f64,
    /// Pixels per unit of y/(z + d).
    pub focal_px: f64,
}

/// A wire that a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenWire {
    /// Its strand.
    pub strand: usize,
    /// Its number in the strand.
    pub wire: usize,
    /// Pixels that it moves per rad that its strand turns round the rope.
    pub by_strand_px: f64,
    /// Pixels that it moves per rad that it turns in its strand.
    pub by_wire_px: f64,
}

impl SeenRope {
    /// A rope of touching circles [Wacker13, fig. 3a], before a camera that shows a cylinder of its diameter `width_px` wide.
    pub fn new(strands: usize, wires: usize, diameter_mm: f64, width_px: f64, distance_mm: f64) -> Self {
        // n touching circles of diameter 1 have their centres on a circle of radius 1 / (2 sin(pi/n))
        let ring = |n: usize| 0.5 / (PI / n as f64).sin();
        let strand_diameter_mm = diameter_mm / (2.0 * ring(strands) + 1.0);
        let wire_diameter_mm = strand_diameter_mm / (2.0 * ring(wires) + 1.0);
        let radius_mm = diameter_mm / 2.0;
        let edge = radius_mm / (distance_mm * distance_mm - radius_mm * radius_mm).sqrt();
        Self {
            strands,
            wires,
            strand_curve_mm: ring(strands) * strand_diameter_mm,
            strand_radius_mm: strand_diameter_mm / 2.0,
            wire_curve_mm: ring(wires) * wire_diameter_mm,
            wire_radius_mm: wire_diameter_mm / 2.0,
            distance_mm,
            focal_px: width_px / 2.0 / edge,
        }
    }

    /// Columns of the outline from the rope axis, lower and upper, at a phase of the strands. [Wacker13, eq. 6-8]
    pub fn outline_px(&self, phase_rad: f64) -> (f64, f64) {
        (0..self.strands).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), j| {
            let (sin, cos) = (phase_rad + self.strand_step(j)).sin_cos();
            let (y, w) = (self.strand_curve_mm * sin, self.distance_mm - self.strand_curve_mm * cos);
            let (middle, half) = ((y / w).atan(), (self.strand_radius_mm / y.hypot(w)).asin());
            (low.min(self.focal_px * (middle - half).tan()), high.max(self.focal_px * (middle + half).tan()))
        })
    }

    /// How the width of the outline grows with the phase, in px per rad.
    pub fn width_slope_px(&self, phase_rad: f64) -> f64 {
        const STEP: f64 = 1e-5;
        let width = |phase| {
            let (low, high) = self.outline_px(phase);
            high - low
        };
        (width(phase_rad + STEP) - width(phase_rad - STEP)) / (2.0 * STEP)
    }

    /// How both edges of the outline move with the phase, in px per rad.
    pub fn outline_slopes_px(&self, phase_rad: f64) -> (f64, f64) {
        const STEP: f64 = 1e-5;
        let (after, before) = (self.outline_px(phase_rad + STEP), self.outline_px(phase_rad - STEP));
        ((after.0 - before.0) / (2.0 * STEP), (after.1 - before.1) / (2.0 * STEP))
    }

    /// The nearest wire at every one of `columns` (counted from the rope axis), for a phase of the strands and, per strand,
    /// of its wire 0; `None` where no wire is met.
    pub fn wires_at(&self, phase_rad: f64, wire_rad: &[f64], columns: &[f64]) -> Vec<Option<SeenWire>> {
        let mut seen: Vec<(f64, Option<SeenWire>)> = vec![(f64::INFINITY, None); columns.len()];
        for (j, wire_rad) in wire_rad.iter().enumerate().take(self.strands) {
            let (strand_sin, strand_cos) = (phase_rad + self.strand_step(j)).sin_cos();
            for i in 0..self.wires {
                let (wire_sin, wire_cos) = (wire_rad + 2.0 * PI * i as f64 / self.wires as f64).sin_cos();
                let y = self.strand_curve_mm * strand_sin + self.wire_curve_mm * wire_sin;
                let w = self.distance_mm - self.strand_curve_mm * strand_cos - self.wire_curve_mm * wire_cos;
                // d(f y / w) with dy = r cos and dw = r sin
                let slope =
                    |radius_mm: f64, sin: f64, cos: f64| self.focal_px * radius_mm * (cos * w - sin * y) / (w * w);
                let wire = SeenWire {
                    strand: j,
                    wire: i,
                    by_strand_px: slope(self.strand_curve_mm, strand_sin, strand_cos),
                    by_wire_px: slope(self.wire_curve_mm, wire_sin, wire_cos),
                };
                let (centre, half) = (self.focal_px * y / w, self.focal_px * self.wire_radius_mm / w);
                let from = columns.partition_point(|&c| c < centre - half);
                for (column, seen) in columns.iter().zip(&mut seen).skip(from) {
                    if *column > centre + half {
                        break;
                    }
                    // where the ray meets the wire: nearer in its middle than at its edge
                    let part = (column - centre) / half;
                    let depth = w - self.wire_radius_mm * (1.0 - part * part).max(0.0).sqrt();
                    if depth < seen.0 {
                        *seen = (depth, Some(wire));
                    }
                }
            }
        }
        seen.into_iter().map(|(_, wire)| wire).collect()
    }

    /// Phase between strand `j` and the first, in rad.
    fn strand_step(&self, j: usize) -> f64 {
        2.0 * PI * j as f64 / self.strands as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outline_is_as_wide_as_the_rope_where_strands_stand_at_both_sides() {
        let rope = SeenRope::new(6, 9, 20.46, 380.0, 1e6);
        let (low, high) = rope.outline_px(PI / 2.0);
        assert!((high - low - 380.0).abs() < 0.01);
        assert!(rope.width_slope_px(PI / 2.0).abs() < 0.01); // widest: no slope, so nothing to learn here
        assert!(rope.width_slope_px(PI / 2.0 + 0.4).abs() > 10.0);
    }

    #[test]
    fn a_wire_moves_as_its_slope_says() {
        let rope = SeenRope::new(6, 9, 32.0, 380.0, 224.0);
        let columns: Vec<f64> = (0..3800).map(|c| f64::from(c) * 0.1 - 190.0).collect();
        let middle = |wire_rad: f64| {
            // the wire in front of everything: strand 0, wire 0
            let seen = rope.wires_at(0.0, &[wire_rad, 0.3, 0.3, 0.3, 0.3, 0.3], &columns);
            let of: Vec<usize> =
                (0..columns.len()).filter(|&c| seen[c].is_some_and(|w| (w.strand, w.wire) == (0, 0))).collect();
            (of.iter().map(|&c| columns[c]).sum::<f64>() / of.len() as f64, seen[of[0]].unwrap())
        };
        let ((before, wire), (after, _)) = (middle(-0.02), middle(0.02));
        let slope = (after - before) / 0.04;
        assert!((slope - wire.by_wire_px).abs() < 0.1 * slope, "{slope} {}", wire.by_wire_px); // a tenth: half covered
    }
}
