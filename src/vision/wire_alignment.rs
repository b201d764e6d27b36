//! Aligns the wires of one strand as the paper does: synthesise, compare, improve. [Wacker13, sec. 3.3.2, eq. 14]
//!
//! A global grid search over lay length and offset, then downhill simplex, both on the correlation of the image with its
//! synthesis over the pixels that show the strand. It is exact and slow, and the reference that the fast way
//! ([`super::unwrapping`], [`super::wire_tracking`]) is tested against.
//!
//! Two deviations. The image is not shifted by the displacement of eq. 10; the synthesis is drawn about the same axis instead,
//! which needs no interpolation of gray values. And the search runs over rate and phase in the middle of what is seen instead of lay
//! length and offset at x = 0: far from the origin these two can hardly be told apart, and a simplex creeps along their valley.

use super::simplex::{Termination, minimise};
use super::strand_pixels::StrandPixels;
use super::wire::WireHelix;
use std::f64::consts::TAU;

/// Steps of the grid over one wire's pitch in the offset, and over one wire's drift at the ends in the rate. A peak of the
/// correlation is about half a wire wide, so no peak falls between.
const STEPS_PER_WIRE: f64 = 8.0;
/// Every how many lines the grid search compares; wires move by a small fraction of their width over so many.
const GRID_STRIDE: usize = 8;
/// Best grid points from which the simplex starts: noise may rank a neighbour first.
const STARTS: usize = 3;
/// Evaluations of one simplex. Two parameters converge in about 60.
const MOST_EVALUATIONS: usize = 200;
/// Spread of the simplex, in steps of the grid, at which it is done: 1e-4 of a wire.
const TOLERANCE: f64 = 1e-3;
/// Wire pitches (lay/M) that must be seen: less does not tell the lay from the offset.
const LEAST_PITCHES: f64 = 2.0;

/// Wires that explain the image of one strand best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WireAlignment {
    /// The wires. Their numbers cannot be seen: the offset is known but for multiples of the wire step.
    pub wire: WireHelix,
    /// Correlation of image and synthesis, in [-1, 1].
    pub score: f64,
    /// Number of syntheses.
    pub evaluations: usize,
    /// Why the simplex stopped.
    pub termination: Termination,
}

impl StrandPixels<'_> {
    /// The wires with lay lengths between `lays_mm` (both of one sign) that maximise the correlation. `None` if the strand is seen
    /// for too short a piece, or the optimum lies at an edge of the range: an edge is never an answer.
    pub fn align_wires(&self, lays_mm: (f64, f64)) -> Option<WireAlignment> {
        let (first_mm, last_mm) = self.extent_mm()?;
        let (middle_mm, length_mm) = ((first_mm + last_mm) / 2.0, last_mm - first_mm);
        let m = self.rope.wires() as f64;
        let shortest_mm = lays_mm.0.abs().min(lays_mm.1.abs());
        let (slow, fast) = {
            let (a, b) = (TAU / lays_mm.0, TAU / lays_mm.1);
            (a.min(b), a.max(b))
        };
        let usable = slow.is_finite() && fast.is_finite() && slow * fast > 0.0;
        if !usable || length_mm < LEAST_PITCHES * shortest_mm / m {
            return None;
        }
        let helix = |at: &[f64; 2]| WireHelix {
            lay_length_mm: TAU / at[0],
            offset_rad: at[1] - at[0] * middle_mm, // phase at[1] in the middle of what is seen
        };

        // A change of the rate by one wire step over half the length moves the ends by one wire.
        let rate_step = self.rope.wire_step_rad() / (length_mm / 2.0) / STEPS_PER_WIRE;
        let phase_step = self.rope.wire_step_rad() / STEPS_PER_WIRE;
        let rates = ((fast - slow) / rate_step).ceil().max(2.0) as usize;
        let rate_step = (fast - slow) / rates as f64;
        let mut grid: Vec<(f64, usize, usize)> = Vec::with_capacity((rates + 1) * STEPS_PER_WIRE as usize);
        for rate in 0..=rates {
            for phase in 0..STEPS_PER_WIRE as usize {
                let at = [slow + rate as f64 * rate_step, phase as f64 * phase_step];
                grid.push((self.correlation(helix(&at), GRID_STRIDE), rate, phase));
            }
        }
        grid.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut evaluations = grid.len();
        let mut best: Option<([f64; 2], f64, Termination)> = None;
        for &(_, rate, phase) in grid.iter().take(STARTS).filter(|(_, rate, _)| (1..rates).contains(rate)) {
            let start = [slow + rate as f64 * rate_step, phase as f64 * phase_step];
            let cost = |at: &[f64; 2]| -self.correlation(helix(at), 1);
            let found = minimise(cost, start, [rate_step / 2.0, phase_step / 2.0], TOLERANCE, MOST_EVALUATIONS);
            evaluations += found.evaluations;
            let inside = found.at[0] > slow && found.at[0] < fast;
            if inside && best.as_ref().is_none_or(|(_, cost, _)| found.cost < *cost) {
                best = Some((found.at, found.cost, found.termination));
            }
        }
        let (at, cost, termination) = best?;
        let wire = helix(&at);
        Some(WireAlignment {
            wire: WireHelix { offset_rad: wire.offset_rad.rem_euclid(TAU), ..wire },
            score: -cost,
            evaluations,
            termination,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::Camera;
    use crate::vision::rope::{Rope, RopeDesign};
    use crate::vision::strand::StrandHelix;
    use crate::vision::strand_pixels::ViewLines;
    use crate::vision::synthesis::{Raster, gray_image, synthesise};

    /// White noise of the standard deviation `sd`: twelve uniform numbers have the variance 1.
    fn noise(sd: f32) -> impl FnMut() -> f32 {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        move || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 40) as f32 / (1u64 << 24) as f32
            };
            sd * ((0..12).map(|_| uniform()).sum::<f32>() - 6.0)
        }
    }

    fn rope(strands: usize, wires_per_strand: usize) -> Rope {
        RopeDesign {
            strands,
            wires_per_strand,
            diameter_mm: 24.0,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap()
    }

    const LINES: usize = 500;
    const PITCH_MM: f64 = 0.4;

    /// Renders 200 mm of a rope whose axis swings, and aligns the wires of every strand that is seen for a third of it.
    fn errors(strands: usize, wires: usize, strand_lay_mm: f64, wire_lay_mm: f64, sd: f32) -> Vec<(f64, f64)> {
        let rope = rope(strands, wires);
        let camera = Camera { angle_rad: 0.7, distance_mm: 168.0, px_per_mm: 14.0 };
        let strand = StrandHelix { lay_length_mm: strand_lay_mm, offset_rad: 0.2 };
        let truth: Vec<WireHelix> = (0..strands)
            .map(|j| WireHelix {
                lay_length_mm: wire_lay_mm * (1.0 + 0.02 * (j as f64 - 2.0)),
                offset_rad: 0.37 * j as f64,
            })
            .collect();
        let raster = Raster { lines: 0..LINES, pitch_mm: PITCH_MM, width_px: 420 };
        let axis_px: Vec<f32> = (0..LINES).map(|k| 209.5 + 4.0 * (k as f32 / 70.0).sin()).collect();
        let pixels = synthesise(&rope, &camera, strand, &truth, &raster, |line| f64::from(axis_px[line]));
        let image = gray_image(&pixels, 420, 10.0, 200.0, noise(sd)).unwrap();
        let view = ViewLines { image: &image, axis_px: &axis_px, first_mm: 0.0, pitch_mm: PITCH_MM };
        (0..strands)
            .filter_map(|j| {
                let seen = StrandPixels::gather(&rope, &camera, view, j, |line, out| {
                    for (j, phase) in out.iter_mut().enumerate() {
                        *phase = strand.phase_rad(&rope, j, line as f64 * PITCH_MM);
                    }
                });
                if seen.length_mm() < LINES as f64 * PITCH_MM / 3.0 {
                    return None;
                }
                let found =
                    seen.align_wires((wire_lay_mm * 0.75, wire_lay_mm * 1.25)).expect("the wires are in the image");
                assert_eq!(found.termination, Termination::Converged);
                let lay_error_mm = found.wire.lay_length_mm - truth[j].lay_length_mm;
                let middle_mm = seen.extent_mm().map(|(a, b)| (a + b) / 2.0).unwrap();
                let off = found.wire.phase_rad(&rope, 0, middle_mm) - truth[j].phase_rad(&rope, 0, middle_mm);
                let step = rope.wire_step_rad();
                Some((lay_error_mm, off - (off / step).round() * step))
            })
            .collect()
    }

    /// Without noise the rounding of gray values and the tolerance of the simplex are left. Noise of a tenth of the contrast moved
    /// lays by 0.002 mm (sd) and phases by 1e-4 rad when this was written; the limits are ten and five times that.
    #[test]
    fn finds_the_wires_it_was_drawn_with() {
        for (strands, wires, strand_lay_mm, wire_lay_mm, sd) in [
            (6, 9, 165.0, -71.0, 0.0), // ordinary lay
            (6, 9, 165.0, -71.0, 20.0),
            (8, 7, -165.0, -62.0, 20.0), // Lang lay, left-hand
            (6, 12, 165.0, -71.0, 20.0), // many thin wires
        ] {
            let (most_mm, most_rad) = if sd > 0.0 { (0.02, 5e-4) } else { (0.005, 2e-4) };
            let errors = errors(strands, wires, strand_lay_mm, wire_lay_mm, sd);
            assert!(errors.len() >= strands - 2, "{} strands seen", errors.len());
            for (lay_mm, phase_rad) in errors {
                assert!(lay_mm.abs() < most_mm, "{strands}x{wires}, noise {sd}: lay off by {lay_mm} mm");
                assert!(phase_rad.abs() < most_rad, "{strands}x{wires}, noise {sd}: phase off by {phase_rad} rad");
            }
        }
    }

    #[test]
    fn wires_outside_the_range_are_no_answer() {
        let rope = rope(6, 9);
        let camera = Camera { angle_rad: 0.0, distance_mm: 168.0, px_per_mm: 14.0 };
        let strand = StrandHelix { lay_length_mm: 165.0, offset_rad: 0.0 };
        let truth = [WireHelix { lay_length_mm: -71.0, offset_rad: 0.0 }; 6];
        let raster = Raster { lines: 0..500, pitch_mm: 0.2, width_px: 420 };
        let pixels = synthesise(&rope, &camera, strand, &truth, &raster, |_| 209.5);
        let image = gray_image(&pixels, 420, 10.0, 200.0, || 0.0).unwrap();
        let view = ViewLines { image: &image, axis_px: &[209.5; 500], first_mm: 0.0, pitch_mm: 0.2 };
        let phases = |line: usize, out: &mut [f64]| {
            out.iter_mut().enumerate().for_each(|(j, p)| *p = strand.phase_rad(&rope, j, line as f64 * 0.2));
        };
        let seen = StrandPixels::gather(&rope, &camera, view, 0, phases);
        assert!(seen.align_wires((-71.0, -90.0)).is_none(), "at the edge");
        assert!(seen.align_wires((-71.0, 71.0)).is_none(), "no range of one hand");
        let short = ViewLines { axis_px: &[f32::NAN; 500], ..view };
        assert!(
            StrandPixels::gather(&rope, &camera, short, 0, phases).align_wires((-60.0, -80.0)).is_none(),
            "nothing seen"
        );
    }
}
