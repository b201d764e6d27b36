//! Follows the wires of every strand from knot to knot by their stripes. [Wacker13, sec. 3.3.2, replaced by unwrapping]

use super::rope::Rope;
use super::smoothing::Measurement;
use super::unwrapping::{FACETS, FARTHEST_RAD, Phasor, Stripe, Stripes};
use super::wire_prediction::WirePrediction;
use std::f64::consts::TAU;

/// Readings of one view share dirt and texture: so many count as one independent one. Refined from residuals.
const READINGS_PER_INDEPENDENT: f64 = 2.0;

/// Places on a strand by the strand's phase in view, for [`StripeShift`].
const ASPECTS: usize = 12;

/// Where light puts the bright line of a wire, beside its centre, on every facet of a strand at every phase in view: unit
/// phasors, real and imaginary parts.
#[derive(Debug, Clone, PartialEq)]
pub struct StripeShift {
    facets: [([f32; FACETS], [f32; FACETS]); ASPECTS],
}

fn aspect(stripe: &Stripe) -> usize {
    let share = 0.5 + 0.5 * f64::from(stripe.phase_in_view_rad) / FARTHEST_RAD;
    ((share * ASPECTS as f64).max(0.0) as usize).min(ASPECTS - 1)
}

impl Default for StripeShift {
    fn default() -> Self {
        Self { facets: [([1.0; FACETS], [0.0; FACETS]); ASPECTS] }
    }
}

impl StripeShift {
    /// What a reading says of the wires, the lighting's shift of every facet taken out.
    pub fn correct(&self, stripe: &Stripe) -> Phasor {
        let (cos, sin) = &self.facets[aspect(stripe)];
        let re: [f32; FACETS] = std::array::from_fn(|f| stripe.re[f] * cos[f] + stripe.im[f] * sin[f]);
        let im: [f32; FACETS] = std::array::from_fn(|f| stripe.im[f] * cos[f] - stripe.re[f] * sin[f]);
        (re.iter().sum::<f32>().into(), im.iter().sum::<f32>().into())
    }
}

/// Sums from which [`StripeShift`]s are learnt: mean phasor of the stripes about the tracked wires, per view, aspect and facet.
#[derive(Debug, Clone)]
pub struct ShiftSums {
    views: Vec<[[Phasor; FACETS]; ASPECTS]>,
}

impl ShiftSums {
    /// Empty sums for so many views.
    pub fn new(views: usize) -> Self {
        Self { views: vec![[[(0.0, 0.0); FACETS]; ASPECTS]; views] }
    }

    /// Adds a reading of `view` where the wires were tracked at `wire_phase_rad`.
    pub fn add(&mut self, view: usize, wires: usize, stripe: &Stripe, wire_phase_rad: f64) {
        let (sin, cos) = (wires as f64 * wire_phase_rad).sin_cos();
        for (f, sum) in self.views[view][aspect(stripe)].iter_mut().enumerate() {
            let (re, im) = (f64::from(stripe.re[f]), f64::from(stripe.im[f]));
            sum.0 += re * cos - im * sin;
            sum.1 += re * sin + im * cos;
        }
    }

    /// The shifts. Only differences can be known, so the mean over everything is set to none.
    pub fn shifts(&self) -> Vec<StripeShift> {
        let total = self.views.iter().flatten().flatten().fold((0.0f64, 0.0f64), |t, s| (t.0 + s.0, t.1 + s.1));
        let norm = total.0.hypot(total.1).max(1e-12);
        let (c, s) = (total.0 / norm, total.1 / norm);
        let shift = |(re, im): Phasor| {
            let (re, im) = (re * c + im * s, im * c - re * s);
            let norm = re.hypot(im);
            if norm > 0.0 { (re / norm, im / norm) } else { (1.0, 0.0) }
        };
        self.views
            .iter()
            .map(|aspects| StripeShift {
                facets: aspects.map(|facets| {
                    let facets = facets.map(shift);
                    (facets.map(|(re, _)| re as f32), facets.map(|(_, im)| im as f32))
                }),
            })
            .collect()
    }
}

/// Where readings lie, and how they fall into knots.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Rope position of line 0 of the stretch in mm.
    pub first_mm: f64,
    /// Rope per line in mm.
    pub pitch_mm: f64,
    /// Lines from one reading to the next.
    pub reading_lines: usize,
    /// Lines per knot.
    pub knot_lines: usize,
    /// Number of knots.
    pub knots: usize,
}

impl Grid {
    /// Position of a reading in mm.
    pub fn reading_mm(&self, reading: usize) -> f64 {
        self.first_mm + (reading * self.reading_lines) as f64 * self.pitch_mm
    }

    /// The knot that a reading belongs to.
    pub fn knot_of(&self, reading: usize) -> usize {
        (reading * self.reading_lines / self.knot_lines).min(self.knots - 1)
    }

    /// Position of the middle of a knot in mm.
    pub fn knot_mm(&self, knot: usize) -> f64 {
        self.first_mm + ((knot * self.knot_lines) as f64 + (self.knot_lines as f64 - 1.0) / 2.0) * self.pitch_mm
    }
}

/// The wires of a strand at one knot, as one view shows them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WireKnot {
    /// Phase of wire 0, if the strand stands where it was taken to stand.
    pub measured: Measurement,
    /// How much farther the wires seem to be, per rad that the strand is farther than it was taken to be.
    pub strand_share: f64,
    /// Phase in rad where the strand was taken to stand.
    pub strand_rad: f64,
}

impl WireKnot {
    /// What was measured of "wire phase + share * strand phase".
    pub fn joint(&self) -> Measurement {
        Measurement { value_rad: self.measured.value_rad + self.strand_share * self.strand_rad, ..self.measured }
    }
}

/// How much farther the wires of a strand seem to be, per rad that the strand is farther.
///
/// A strand that stands farther by dphi moves sideways by r_s cos(phase in view) dphi, and its wires, whose place on the strand is
/// an angle, seem turned by that over the strand's radius, those away from the strand's middle more; near the rope's edges the
/// strand also hides behind its neighbours. Factor and bend were measured on seven ropes of 4 to 8 strands, ordinary and Lang lay,
/// which agree within 0.1.
pub(super) fn strand_share(rope: &Rope, phase_in_view_rad: f64) -> f64 {
    let cos = phase_in_view_rad.cos();
    1.43 * rope.strand_curve_radius_mm() / rope.strand_radius_mm() * cos * (3.0 + cos) / 4.0
}

/// Measures the wires of strand `j` at every knot of a stretch in one view, relative to a prediction. `strand_rad(knot)` is where
/// the strand was taken to stand when the stripes were read.
#[expect(clippy::too_many_arguments, reason = "what is seen, where, and what is known of it")]
pub fn wire_knots(
    rope: &Rope,
    stripes: &Stripes,
    shift: &StripeShift,
    j: usize,
    grid: Grid,
    prediction: WirePrediction,
    noise_scale: f64,
    strand_rad: impl Fn(usize) -> f64,
    angle_rad: f64,
) -> Vec<WireKnot> {
    let n = rope.strands();
    let m = rope.wires() as f64;
    let mut sums = vec![(0.0f64, 0.0f64, 0.0f64, 0.0f64); grid.knots];
    for (reading, row) in stripes.stripes.chunks_exact(n).enumerate() {
        if row[j].pixels <= 0.0 {
            continue;
        }
        let (re, im) = shift.correct(&row[j]);
        let (sin, cos) = (m * prediction.at(grid.reading_mm(reading))).sin_cos();
        let sum = &mut sums[grid.knot_of(reading)];
        sum.0 += re * cos - im * sin;
        sum.1 += re * sin + im * cos;
        sum.2 += re * re + im * im;
        sum.3 += 1.0;
    }
    // Scatter of single readings about their knot's mean: the noise that the phase of the mean has.
    let (scatter, count) = sums
        .iter()
        .filter(|s| s.3 >= 2.0)
        .fold((0.0, 0.0), |(t, c), s| (t + s.2 - (s.0 * s.0 + s.1 * s.1) / s.3, c + s.3 - 1.0));
    let variance = (scatter / f64::max(count, 1.0) / 2.0).max(1e-9) * READINGS_PER_INDEPENDENT * noise_scale;
    sums.iter()
        .enumerate()
        .map(|(k, &(re, im, _, count))| {
            let power = re * re + im * im;
            if count < 1.0 || power <= 0.0 {
                return WireKnot::default();
            }
            // The coefficient turns with exp(-i M phase).
            let off = -im.atan2(re) / m;
            // Variance of the angle of the sum: count * variance / power, and a floor for what single knots can be trusted.
            let sd_stripes = (count * variance / power).sqrt().max(0.05);
            if sd_stripes > 1.0 {
                return WireKnot::default(); // the phase of noise
            }
            let value_rad = prediction.at(grid.knot_mm(k)) + off;
            let strand_rad = strand_rad(k);
            WireKnot {
                measured: Measurement { value_rad, information: (m / sd_stripes).powi(2) },
                strand_share: strand_share(rope, strand_rad - angle_rad),
                strand_rad,
            }
        })
        .collect()
}

/// What strand `j` says in all views, light's shift taken out, sorted by position in mm.
pub fn readings(rope: &Rope, views: &[(&Stripes, &StripeShift)], j: usize, grid: Grid) -> Vec<(f64, Phasor)> {
    let n = rope.strands();
    let mut all: Vec<(f64, Phasor)> = Vec::new();
    for (stripes, shift) in views {
        for (reading, row) in stripes.stripes.chunks_exact(n).enumerate() {
            if row[j].pixels > 0.0 {
                all.push((grid.reading_mm(reading), shift.correct(&row[j])));
            }
        }
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// How well the stripes of strand `j` in one view agree with wires on `phase_rad(position)`: |sum|/sum of amplitudes.
pub fn coherence(
    rope: &Rope,
    views: &[(&Stripes, &StripeShift)],
    j: usize,
    grid: Grid,
    phase_rad: impl Fn(f64) -> f64,
) -> f64 {
    let n = rope.strands();
    let m = rope.wires() as f64;
    let (mut sum, mut total) = ((0.0, 0.0), 0.0);
    for (stripes, shift) in views {
        for (reading, row) in stripes.stripes.chunks_exact(n).enumerate() {
            if row[j].pixels > 0.0 {
                let (re, im) = shift.correct(&row[j]);
                let (sin, cos) = (m * phase_rad(grid.reading_mm(reading))).sin_cos();
                sum.0 += re * cos - im * sin;
                sum.1 += re * sin + im * cos;
                total += re.hypot(im);
            }
        }
    }
    if total > 0.0 { f64::hypot(sum.0, sum.1) / total } else { 0.0 }
}

/// Wire lays to search when none is given, in strand diameters, either hand.
pub const SEARCHED_LAY_STRAND_DIAMETERS: (f64, f64) = (5.0, 16.0);
/// How far a wire lay may be off its nominal value, as a share: wires cannot be taken for their neighbours, so it may be wide.
pub const NOMINAL_TOLERANCE: f64 = 0.27;

/// Intervals of the wire rate in rad/mm to search.
pub fn searched_rates(rope: &Rope) -> Vec<(f64, f64)> {
    match rope.design().wire_lay_mm {
        Some(lay) => vec![(TAU / (lay * (1.0 + NOMINAL_TOLERANCE)), TAU / (lay * (1.0 - NOMINAL_TOLERANCE)))],
        None => {
            let diameter = 2.0 * rope.strand_radius_mm();
            let (short, long) =
                (SEARCHED_LAY_STRAND_DIAMETERS.0 * diameter, SEARCHED_LAY_STRAND_DIAMETERS.1 * diameter);
            vec![(TAU / long, TAU / short), (-TAU / short, -TAU / long)]
        }
    }
}
