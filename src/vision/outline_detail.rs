//! What the real outline of a rope has beside that of the model: bumps of the wires, and how strands differ from round rods.
//!
//! The model's strands are smooth (eq. 6-8). On a real strand the outermost wire makes the outline, which so rises and falls
//! by rho (1 - cos(pi/M)), a tenth of a wire's lay apart: several pixels, and by far the largest "noise" of the contours. It
//! follows the wires strictly, so it is learnt from the rope once these are tracked, and taken out.

use super::contour::Contours;
use super::model_contour::ModelContour;
use super::registration::{CONTOUR_CUT_PX, SIDES_RAD, strand_at_side};
use super::rope::Rope;
use super::surface::fraction;

/// Harmonics of the wire period that are kept: bumps of round wires have sharp valleys between them.
const HARMONICS: usize = 3;
/// Bins of the phase within one strand step.
const BINS: usize = 48;
/// Lines that a bin needs for half of its mean to be believed.
const SHRINKAGE: f64 = 50.0;
/// Every how many lines are learnt from.
const STRIDE: usize = 2;

/// Phases of all strands and of their wires 0 at one line, in rope axes; wires NaN where unknown.
pub struct LinePhases<'a> {
    /// Strands.
    pub strands_rad: &'a [f64],
    /// Wires.
    pub wires_rad: &'a [f64],
}

/// Sums from which the detail is learnt, for the upper and the lower side.
#[derive(Debug, Clone, Default)]
pub struct DetailSums {
    sides: [SideSums; 2],
}

#[derive(Debug, Clone)]
struct SideSums {
    bins: [(f64, f64); BINS],
    waves: [(f64, f64); HARMONICS],
    lines: f64,
}

impl Default for SideSums {
    fn default() -> Self {
        Self { bins: [(0.0, 0.0); BINS], waves: [(0.0, 0.0); HARMONICS], lines: 0.0 }
    }
}

/// Where a phase within the strand step falls into the bins.
fn bin(rope: &Rope, phase_in_view_rad: f64) -> usize {
    ((fraction(phase_in_view_rad / rope.strand_step_rad()) * BINS as f64) as usize).min(BINS - 1)
}

/// Cosine and sine of the wire period's first harmonic at a wire phase, and of each one after it.
fn harmonics(rope: &Rope, wire_phase_in_view_rad: f64) -> impl Iterator<Item = (f64, f64)> {
    let (sin, cos) = (rope.wires() as f64 * wire_phase_in_view_rad).sin_cos();
    std::iter::successors(Some((cos, sin)), move |(c, s)| Some((c * cos - s * sin, s * cos + c * sin)))
}

impl DetailSums {
    /// Adds the contours of a stretch in the view at `angle_rad`, whose axis was found; `phases(line)` as they were measured.
    pub fn add(
        &mut self,
        rope: &Rope,
        model: &ModelContour,
        angle_rad: f64,
        contours: &Contours,
        axis_px: &[f32],
        mut phases: impl FnMut(usize, &mut [f64], &mut [f64]),
    ) {
        let n = rope.strands();
        let (mut strands, mut wires) = (vec![0.0; n], vec![f64::NAN; n]);
        for line in (0..contours.len().min(axis_px.len())).step_by(STRIDE) {
            phases(line, &mut strands, &mut wires);
            let columns = [contours.upper_px[line], contours.lower_px[line]];
            for (side, column) in columns.into_iter().enumerate() {
                let j = strand_at_side(&strands, angle_rad, SIDES_RAD[side]);
                if !column.is_finite() || wires[j].is_nan() {
                    continue;
                }
                let phase = strands[j] - angle_rad;
                let difference = f64::from(column - axis_px[line]) - model.edge_px(side, phase);
                if difference.abs() > 2.0 * CONTOUR_CUT_PX {
                    continue;
                }
                let sums = &mut self.sides[side];
                let at = &mut sums.bins[bin(rope, phase)];
                at.0 += difference;
                at.1 += 1.0;
                sums.lines += 1.0;
                for (wave, (cos, sin)) in sums.waves.iter_mut().zip(harmonics(rope, wires[j] - angle_rad)) {
                    wave.0 += difference * cos;
                    wave.1 += difference * sin;
                }
            }
        }
    }
}

/// The learnt detail.
#[derive(Debug, Clone)]
pub struct OutlineDetail {
    sides: [SideDetail; 2],
}

#[derive(Debug, Clone)]
struct SideDetail {
    bins: [f64; BINS],
    waves: [(f64, f64); HARMONICS],
}

impl OutlineDetail {
    /// Divides the sums. `None` if too few lines were added.
    pub fn new(rope: &Rope, model: &ModelContour, sums: &DetailSums) -> Option<Self> {
        if sums.sides.iter().any(|side| side.lines < 500.0) {
            return None;
        }
        let mut bins = [[0.0; BINS]; 2];
        let mut slopes = [[0.0; BINS]; 2];
        for (side, sums) in sums.sides.iter().enumerate() {
            for (k, &(sum, count)) in sums.bins.iter().enumerate() {
                bins[side][k] = sum / (count + SHRINKAGE);
                let at = |k: f64| {
                    let phase = k / BINS as f64 * rope.strand_step_rad();
                    model.edge_px(side, phase)
                };
                slopes[side][k] = at(k as f64 + 1.0) - at(k as f64);
            }
        }
        // A shift of the phase would look like the outline's slope; it is the measurement's to find, not the detail's to hide.
        let pairs = || bins.iter().flatten().zip(slopes.iter().flatten());
        let share = pairs().map(|(b, s)| b * s).sum::<f64>() / pairs().map(|(_, s)| s * s).sum::<f64>().max(1e-9);
        let side = |side: usize| SideDetail {
            bins: std::array::from_fn(|k| bins[side][k] - share * slopes[side][k]),
            waves: sums.sides[side].waves.map(|(re, im)| {
                let scale = 2.0 / sums.sides[side].lines;
                (scale * re, scale * im)
            }),
        };
        Some(Self { sides: [side(0), side(1)] })
    }

    /// The contours less the detail; `phases(line)` as far as they are known.
    pub fn taken_out(
        &self,
        rope: &Rope,
        angle_rad: f64,
        contours: &Contours,
        mut phases: impl FnMut(usize, &mut [f64], &mut [f64]),
    ) -> Contours {
        let n = rope.strands();
        let (mut strands, mut wires) = (vec![0.0; n], vec![f64::NAN; n]);
        let mut out = contours.clone();
        for line in 0..contours.len() {
            phases(line, &mut strands, &mut wires);
            for (side, detail) in self.sides.iter().enumerate() {
                let j = strand_at_side(&strands, angle_rad, SIDES_RAD[side]);
                let mut off_px = detail.bins[bin(rope, strands[j] - angle_rad)];
                if !wires[j].is_nan() {
                    for (&(re, im), (cos, sin)) in detail.waves.iter().zip(harmonics(rope, wires[j] - angle_rad)) {
                        off_px += re * cos + im * sin;
                    }
                }
                let column = if side == 0 { &mut out.upper_px[line] } else { &mut out.lower_px[line] };
                *column -= off_px as f32;
            }
        }
        out
    }
}
