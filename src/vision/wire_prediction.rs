//! Where the wires of a strand are expected, and how that is brought into line with what a stretch shows.

use super::unwrapping::{Phasor, turned_sum, turned_sums};
use std::f64::consts::TAU;

/// How far the wire lay may change from one stretch to the next, as a share.
const STEP_TOLERANCE: f64 = 0.04;
/// Rates that are tried to either side of the predicted one.
const STEPS: usize = 16;
/// One of so many readings is asked whether the rate still holds: neighbours show the same wire.
const READINGS_APART: usize = 2;

/// Straight course that the wires of a strand are expected on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WirePrediction {
    /// Phase of wire 0 in rad at `position_mm`.
    pub phase_rad: f64,
    /// Rate in rad/mm, signed.
    pub rate_rad_per_mm: f64,
    /// Where the phase holds.
    pub position_mm: f64,
}

impl WirePrediction {
    /// Phase of wire 0 at a position.
    pub fn at(&self, position_mm: f64) -> f64 {
        self.phase_rad + self.rate_rad_per_mm * (position_mm - self.position_mm)
    }

    /// The prediction with the rate that a stretch's own stripes agree with best, near the predicted one, and the phase that they
    /// show: a step of the lay must not throw the count off. The second value is the coherence there.
    pub fn adapted(self, wires: usize, readings: &[(f64, Phasor)]) -> (Self, f64) {
        let m = wires as f64;
        let some = || readings.iter().copied().step_by(READINGS_APART);
        let total: f64 = some().map(|(_, (re, im))| re.hypot(im)).sum();
        if readings.len() < 16 || total <= 0.0 {
            return (self, 0.0);
        }
        let rate_at = |k: usize| self.rate_rad_per_mm * (1.0 + STEP_TOLERANCE * (k as f64 / STEPS as f64 - 1.0));
        let sums: [Phasor; 2 * STEPS + 1] = turned_sums(m, some(), rate_at(0), rate_at(1), self.position_mm);
        let coherence = sums.map(|(re, im)| re.hypot(im) / total);
        let now = coherence[STEPS];
        // A better rate must be clearly better: within a wire's pitch noise has its peaks, too.
        let better = coherence.into_iter().enumerate().filter(|(_, coherence)| *coherence > now + 0.1);
        let (k, best) = better.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((STEPS, now));
        let rate = rate_at(k);
        // Far from where the wires were last seen the phase may have come to lie between two of them, where every reading would
        // choose its own. In the middle of the readings it is that of a wire, the nearest one.
        let middle = readings[readings.len() / 2].0;
        let (re, im) = turned_sum(m, readings.iter().copied(), rate, middle);
        let expected = self.phase_rad + rate * (middle - self.position_mm);
        let step = TAU / m;
        let phase = -im.atan2(re) / m;
        let phase_rad = phase + ((expected - phase) / step).round() * step;
        (Self { phase_rad, rate_rad_per_mm: rate, position_mm: middle }, best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIRES: usize = 9;

    /// 200 mm of readings, 0.5 mm apart, of wires that run on `phase_rad(position)`.
    fn readings(phase_rad: impl Fn(f64) -> f64) -> Vec<(f64, Phasor)> {
        let reading = |k: usize| {
            let position_mm = 0.5 * k as f64;
            let (sin, cos) = (WIRES as f64 * phase_rad(position_mm)).sin_cos();
            (position_mm, (cos, -sin)) // stripes turn against the wires
        };
        (0..400).map(reading).collect()
    }

    #[test]
    fn a_prediction_that_lies_between_two_wires_takes_to_one_of_them() {
        let truth = |mm: f64| 0.3 + TAU / 95.0 * mm;
        let step = TAU / WIRES as f64;
        for share in [0.0, 0.3, 0.5, 0.7] {
            let predicted = WirePrediction {
                phase_rad: truth(500.0) + share * step,
                rate_rad_per_mm: TAU / 95.0,
                position_mm: 500.0,
            };
            let (adapted, coherence) = predicted.adapted(WIRES, &readings(truth));
            assert!(coherence > 0.99, "{coherence}");
            for mm in [0.0, 100.0, 200.0] {
                let wires_off = (adapted.at(mm) - truth(mm)) / step;
                assert!((wires_off - wires_off.round()).abs() < 0.01, "{share} of a step off: {wires_off} at {mm} mm");
                assert!(wires_off.abs() < 1.01, "the nearest wire: {wires_off}");
            }
        }
    }

    #[test]
    fn a_step_of_the_lay_is_taken_over() {
        let rate = TAU / 93.0;
        let predicted = WirePrediction { phase_rad: 0.2, rate_rad_per_mm: TAU / 95.0, position_mm: 0.0 };
        let (adapted, coherence) = predicted.adapted(WIRES, &readings(|mm| 0.2 + rate * mm));
        assert!((adapted.rate_rad_per_mm / rate - 1.0).abs() < 0.003 && coherence > 0.9, "{adapted:?} {coherence}");
    }
}
