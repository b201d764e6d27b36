//! Reads the wires' phase from the unwrapped surface of a strand.
//!
//! On the surface angle psi of a strand the M wires are stripes of period 2 pi/M that move with the wire phase (eq. 3). One
//! Fourier coefficient per line, sum of gray * exp(-i M psi), turns with exp(-i M phase): lay length and offset become the
//! frequency and phase of one spectral line. The paper's grid search over rendered projections (eq. 14) finds the same optimum
//! and serves as the reference in `wire_alignment`.

use super::image::GrayImage;
use super::rope::Rope;
use super::shade::{PLACES, Shade};
use super::surface::{Outlines, raised};
use super::template::normalised_line;
use std::f64::consts::TAU;

/// Strands whose phase in view is beyond this show too little surface.
pub const FARTHEST_RAD: f64 = 1.2;
/// Surface beyond this share of the strand's half width is too foreshortened for single wires.
const EDGE: f64 = 0.93;
/// Relative differences beyond this are highlights or dirt, and are cut.
const CUT: f32 = 0.6;
/// Entries of the table of exp(-i M asin(e)) over e in [-1, 1].
const TABLE: usize = 1024;
/// Binary digits of a place in the table that are beyond the whole entry.
const PLACE_BITS: u32 = 20;
const PARTS: f64 = (1 << PLACE_BITS) as f64;

/// Facets of a strand's surface, by the angle psi against the view: a light that does not move puts the bright line of every
/// wire on a facet equally far beside the wire's centre, whatever the strand's phase.
pub const FACETS: usize = 8;
/// Surface angle that the facets cover, to either side of the view axis, in rad.
const FACETS_RAD: f64 = 1.3;

/// One reading: the Fourier coefficients of one strand in one line of one view, facet by facet.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stripe {
    /// Real parts.
    pub re: [f32; FACETS],
    /// Imaginary parts.
    pub im: [f32; FACETS],
    /// Number of pixels; 0 where the strand is hidden.
    pub pixels: f32,
    /// Phase of the strand in this view in rad.
    pub phase_in_view_rad: f32,
}

/// Sum over all facets: what one strand's stripes say in one line.
pub type Phasor = (f64, f64);

/// Readings of a stretch in one view: `stripes[reading * strands + j]`, one reading every `reading_lines`.
#[derive(Debug, Clone, Default)]
pub struct Stripes {
    /// The readings.
    pub stripes: Vec<Stripe>,
}

/// Table of exp(-i M asin(e)), where the facets end, and which lines are read.
#[derive(Debug, Clone)]
pub struct StripeTable {
    reading_lines: usize,
    waves: Vec<(f32, f32)>,
    /// Sine and cosine of the surface angle at which each facet but the last ends.
    ends: [(f64, f64); FACETS - 1],
}

impl StripeTable {
    /// The table for M wires, to read one line of `reading_lines`.
    pub fn new(wires: usize, reading_lines: usize) -> Self {
        let angle = |k: usize| wires as f64 * (2.0 * (k as f64 + 0.5) / TABLE as f64 - 1.0).asin();
        let end_rad = |facet: usize| FACETS_RAD * (2.0 * (facet + 1) as f64 / FACETS as f64 - 1.0);
        Self {
            reading_lines,
            waves: (0..TABLE).map(|k| (angle(k).cos() as f32, -angle(k).sin() as f32)).collect(),
            ends: std::array::from_fn(|facet| end_rad(facet).sin_cos()),
        }
    }
}

/// Reads the stripes of all strands. `phases_rad` and `axis_px` as in [`super::registration::register`].
pub fn read_stripes(
    rope: &Rope,
    outlines: &Outlines,
    shade: &Shade,
    table: &StripeTable,
    image: &GrayImage,
    axis_px: &[f32],
    phases_rad: impl Fn(usize, &mut [f64]),
) -> Stripes {
    let width = shade.width();
    let n = rope.strands();
    let m = rope.wires() as f64;
    let readings = image.lines().div_ceil(table.reading_lines);
    let mut stripes = vec![Stripe::default(); readings * n];
    let mut line = vec![0.0f32; width];
    let mut phases = vec![0.0f64; n];
    let mut spans = Vec::new();
    for reading in 0..readings {
        let k = reading * table.reading_lines;
        if !normalised_line(image.line(k), axis_px[k], &mut line) {
            continue;
        }
        phases_rad(k, &mut phases);
        outlines.visible_spans(&phases, &mut spans);
        for span in &spans {
            if span.phase_in_view_rad.abs() > FARTHEST_RAD {
                continue;
            }
            let middle = (width / 2) as f64;
            let low = span.from_px.max(span.middle_px - EDGE * span.half_px);
            let high = span.to_px.min(span.middle_px + EDGE * span.half_px);
            let from = (raised(middle + low).max(0.0) as usize).min(width);
            let to = ((middle + high).max(0.0) as usize).clamp(from, width);
            let gain = shade.gain(span.phase_in_view_rad);
            let scale = TABLE as f64 / (2.0 * span.half_px);
            let first = TABLE as f64 / 2.0 + (from as f64 - middle - span.middle_px) * scale;
            // Places in the table, counted in small parts of an entry.
            let (mut place, scale) = ((first * PARTS) as u32, (scale * PARTS) as u32);
            let mut stripe = Stripe {
                pixels: (to - from) as f32,
                phase_in_view_rad: span.phase_in_view_rad as f32,
                ..Stripe::default()
            };
            // psi in rope axes is asin(e) - sight + view angle.
            let turn = m * (span.sight_rad - outlines.angle_rad());
            let (s, co) = (turn.sin() as f32, turn.cos() as f32);
            let (sin, cos) = span.sight_rad.sin_cos();
            let mut start = from;
            for facet in 0..FACETS {
                let edge = |&(sine, cosine): &(f64, f64)| span.middle_px + span.half_px * (sine * cos + cosine * sin);
                let edge = table.ends.get(facet).map_or(high, edge);
                let end = (raised(middle + edge).max(0.0) as usize).clamp(start, to);
                let (mut re, mut im) = (0.0f32, 0.0f32);
                for gray in &line[start..end] {
                    let entry = (place >> PLACE_BITS) as usize & (TABLE - 1);
                    let difference = (gray * gain[entry / (TABLE / PLACES)] - 1.0).clamp(-CUT, CUT);
                    let (cos, sin) = table.waves[entry];
                    re += difference * cos;
                    im += difference * sin;
                    place = place.wrapping_add(scale);
                }
                stripe.re[facet] = re * co - im * s;
                stripe.im[facet] = re * s + im * co;
                start = end;
            }
            stripes[reading * n + span.strand] = stripe;
        }
    }
    Stripes { stripes }
}

/// Sum of phasors turned back by a rate about `origin_mm`.
pub(super) fn turned_sum(m: f64, readings: impl Iterator<Item = (f64, Phasor)>, rate: f64, origin_mm: f64) -> Phasor {
    readings.fold((0.0, 0.0), |(re, im), (x, (a, b))| {
        let (sin, cos) = (m * rate * (x - origin_mm)).sin_cos();
        (re + a * cos - b * sin, im + a * sin + b * cos)
    })
}

/// The same at R rates as far apart as the first two.
pub(super) fn turned_sums<const R: usize>(
    m: f64,
    readings: impl Iterator<Item = (f64, Phasor)>,
    first_rate: f64,
    second_rate: f64,
    origin_mm: f64,
) -> [Phasor; R] {
    let mut sums = [(0.0, 0.0); R];
    for (x, (a, b)) in readings {
        let turns = m * (x - origin_mm);
        let (sin, cos) = (turns * first_rate).sin_cos();
        let (mut re, mut im) = (a * cos - b * sin, a * sin + b * cos);
        let (sin, cos) = (turns * (second_rate - first_rate)).sin_cos();
        for sum in &mut sums {
            *sum = (sum.0 + re, sum.1 + im);
            (re, im) = (re * cos - im * sin, re * sin + im * cos);
        }
    }
    sums
}

fn magnitude((re, im): Phasor) -> f64 {
    re.hypot(im)
}

/// Searches the wires of one strand in `passes` (readings of one view without a gap: position in mm and coefficients): the rate
/// between `rates` (rad/mm, signed) with the most coherent stripes.
///
/// Light shifts the stripes of every facet by an unknown amount, and between passes the count of wires is open; so facets and
/// passes are judged each on its own and their magnitudes added. `None` if no pass is two wire pitches long, or where the best
/// rate lies at the edge of the range. Answers the rate and the share of coherent amplitude.
pub fn search_rate(wires: usize, passes: &[&[(f64, Stripe)]], rates: (f64, f64)) -> Option<(f64, f64)> {
    let m = wires as f64;
    let pitch_mm = TAU / (m * rates.0.abs().min(rates.1.abs()));
    let longest_mm = passes.iter().map(|p| p[p.len() - 1].0 - p[0].0).fold(0.0, f64::max);
    if longest_mm < 2.0 * pitch_mm {
        return None;
    }
    let facet = |f: usize| move |(x, s): &(f64, Stripe)| (*x, (f64::from(s.re[f]), f64::from(s.im[f])));
    let total: f64 =
        passes.iter().flat_map(|p| p.iter()).flat_map(|r| (0..FACETS).map(move |f| magnitude(facet(f)(r).1))).sum();
    if total <= 0.0 {
        return None;
    }
    let power = |rate: f64| {
        let mut apart = 0.0;
        for pass in passes {
            let (mut res, mut ims) = ([0.0f32; FACETS], [0.0f32; FACETS]);
            for (x, stripe) in *pass {
                let (sin, cos) = (m * rate * (x - pass[0].0)).sin_cos();
                let (sin, cos) = (sin as f32, cos as f32);
                for f in 0..FACETS {
                    res[f] += stripe.re[f] * cos - stripe.im[f] * sin;
                    ims[f] += stripe.re[f] * sin + stripe.im[f] * cos;
                }
            }
            apart += res.iter().zip(ims).map(|(&re, im)| magnitude((re.into(), im.into()))).sum::<f64>();
        }
        apart / total
    };
    let spacing = TAU / (m * longest_mm * 4.0);
    let count = ((rates.1 - rates.0).abs() / spacing).ceil().max(2.0) as usize;
    let rate_at = |k: usize| rates.0 + (rates.1 - rates.0) * k as f64 / count as f64;
    let (best, _) = (0..=count).map(|k| (k, power(rate_at(k)))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    if best == 0 || best == count {
        return None; // an edge of the grid is never an answer
    }
    let rate = peak(&power, rate_at(best - 1), rate_at(best + 1));
    Some((rate, power(rate)))
}

/// Steps of the golden section: the interval shrinks to a thousandth, and what is found is a start for tracking.
const GOLDEN_STEPS: usize = 15;

/// Golden section for the peak of a function that has one between `low` and `high`.
pub(super) fn peak(of: &impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let near = |low: f64, high: f64| (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut a, mut b) = near(low, high);
    let (mut of_a, mut of_b) = (of(a), of(b));
    for _ in 0..GOLDEN_STEPS {
        // One of the two places inside stays one of the next two.
        if of_a > of_b {
            high = b;
            (b, of_b) = (a, of_a);
            a = near(low, high).0;
            of_a = of(a);
        } else {
            low = a;
            (a, of_a) = (b, of_b);
            b = near(low, high).1;
            of_b = of(b);
        }
    }
    (low + high) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stripes of wires at `rate`, seen in a pass of 70 mm, with a facet that light shifts.
    fn pass(rate: f64, from_mm: f64) -> Vec<(f64, Stripe)> {
        (0..175)
            .map(|k| from_mm + f64::from(k) * 0.4)
            .map(|x| {
                let mut stripe = Stripe { pixels: 1.0, ..Stripe::default() };
                for f in [3, 4] {
                    let (sin, cos) = (9.0 * (rate * x + 0.1) + f as f64).sin_cos();
                    (stripe.re[f], stripe.im[f]) = (cos as f32, -sin as f32);
                }
                (x, stripe)
            })
            .collect()
    }

    #[test]
    fn finds_the_wire_lay_of_either_hand_from_passes() {
        for lay in [79.0, -79.0, 84.5, 62.0] {
            let (a, b) = (pass(TAU / lay, 0.0), pass(TAU / lay, 137.0));
            let (rate, coherence) = search_rate(9, &[&a, &b], (TAU / lay * 0.75, TAU / lay * 1.3)).unwrap();
            assert!((TAU / rate - lay).abs() < 0.1, "{} for {lay}", TAU / rate);
            assert!(coherence > 0.99);
        }
    }

    #[test]
    fn sums_at_several_rates_are_those_at_each_of_them() {
        let readings =
            || pass(TAU / 79.0, 30.0).into_iter().map(|(x, s)| (x, (f64::from(s.re[3]), f64::from(s.im[3]))));
        let rate = |k: usize| TAU / 82.0 + 1e-4 * k as f64;
        let sums: [Phasor; 33] = turned_sums(9.0, readings(), rate(0), rate(1), 12.0);
        for (k, sum) in sums.into_iter().enumerate() {
            let (re, im) = turned_sum(9.0, readings(), rate(k), 12.0);
            assert!((sum.0 - re).hypot(sum.1 - im) < 1e-9 * 175.0, "rate {k}: {sum:?} of {re}, {im}"); // rounding of 175 readings
        }
    }

    #[test]
    fn an_edge_of_the_range_is_no_answer() {
        let a = pass(TAU / 79.0, 0.0);
        assert!(search_rate(9, &[&a], (TAU / 100.0, TAU / 85.0)).is_none());
    }
}
