//! How many wires pass between two passes of a strand before the camera.
//!
//! A single view sees a strand for two fifths of its turn. Within a pass the wires are counted; between passes the count follows
//! from the rate, and a wrong count, by one wire a turn, makes every later pass agree with itself. The rate within passes
//! decides: but light that glides over slanted wires tilts it, by up to a few per cent and alike for all strands, in Lang lay.

use super::rope::Rope;
use std::f64::consts::TAU;

/// Rates of the wires of one strand in rad/mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CountedRate {
    /// Over all passes, as they were counted.
    pub over_passes: f64,
    /// Within the passes, no counting needed.
    pub within_passes: f64,
}

/// Noise of the rate within the passes of one strand, as a share.
const NOISE: f64 = 0.01;
/// Usual tilt of all rates within passes by the light, as a share.
const TILT: f64 = 0.025;
/// Usual deviation of a rope's wire lay from its nominal value, as a share. It decides only between tilts that are alike.
const NOMINAL: f64 = 0.03;
/// Tilts that are tried: so many to either side, a tenth of a per cent each.
const TILTS: i32 = 45;

/// The rates over all passes with the most plausible counts. `strand_rate` in rad/mm; strands without rates stay so.
pub fn recount(rope: &Rope, strand_rate: f64, rates: &[Option<CountedRate>]) -> Vec<Option<f64>> {
    let one_more = strand_rate.abs() / rope.wires() as f64; // one wire more a turn
    let nominal = rope.design().wire_lay_mm.map(|lay| TAU / lay);
    let counted = |tilt: f64| -> (f64, Vec<Option<f64>>) {
        let mut cost = (tilt / TILT).powi(2);
        let (mut sum, mut known) = (0.0, 0.0);
        let recounted = rates
            .iter()
            .map(|rate| {
                rate.map(|rate| {
                    let expected = rate.within_passes / (1.0 + tilt);
                    let counts = ((expected - rate.over_passes) / one_more).round();
                    let recounted = rate.over_passes + counts * one_more;
                    cost += ((recounted - expected) / (NOISE * expected)).powi(2);
                    sum += recounted;
                    known += 1.0;
                    recounted
                })
            })
            .collect();
        if let Some(nominal) = nominal {
            cost += f64::min(((sum / f64::max(known, 1.0) / nominal - 1.0) / NOMINAL).powi(2), 1.0);
        }
        (cost, recounted)
    };
    (-TILTS..=TILTS)
        .map(|k| counted(f64::from(k) / 1000.0))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or_else(|| vec![None; rates.len()], |best| best.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::rope::RopeDesign;

    fn rope(wire_lay_mm: Option<f64>) -> Rope {
        RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm: Some(220.0),
            wire_lay_mm,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap()
    }

    /// Six strands, counted `wrong` wires too many a turn, whose rates within passes are tilted.
    fn rates(lay_mm: f64, wrong: [f64; 6], tilt: f64) -> Vec<Option<CountedRate>> {
        let one_more = TAU / 220.0 / 9.0;
        (0..6)
            .map(|j| {
                let rate = TAU / (lay_mm + 0.4 * (j as f64 - 2.5));
                let noise = 1.0 + 0.004 * (j as f64 - 2.5);
                Some(CountedRate {
                    over_passes: rate + wrong[j] * one_more,
                    within_passes: rate * (1.0 + tilt) * noise,
                })
            })
            .collect()
    }

    #[test]
    fn a_wrong_count_is_put_right_even_under_a_tilt_that_is_half_a_wire() {
        let found = recount(&rope(Some(90.0)), TAU / 220.0, &rates(90.4, [0.0, 1.0, -1.0, 0.0, 1.0, 2.0], 0.022));
        for (j, rate) in found.iter().enumerate() {
            let lay = TAU / rate.unwrap();
            assert!((lay - (90.4 + 0.4 * (j as f64 - 2.5))).abs() < 1e-6, "strand {j}: {lay} mm");
        }
    }

    #[test]
    fn rates_without_a_tilt_are_believed_far_from_the_nominal_lay() {
        for lay in [75.0, 84.5, 97.0, 108.0] {
            let found = recount(&rope(Some(90.0)), TAU / 220.0, &rates(lay, [1.0, 0.0, 0.0, -1.0, 0.0, 0.0], 0.0));
            let mean = found.iter().map(|r| TAU / r.unwrap()).sum::<f64>() / 6.0;
            assert!((mean - lay).abs() < 0.05, "{mean} mm for {lay} mm");
        }
    }
}
