//! By how much estimates err more, or less, than courses and views make believe.
//!
//! A standard deviation is a promise. What it is made of is known, but not how far errors go together: views that look at one rope
//! share some of theirs, which their disagreement does not show, and less of others than is guessed. So the promises were compared
//! with the errors on 53 simulated ropes of three metres, 19 in ordinary and 21 in Lang lay before several cameras and 13 before
//! one, and what was left is made good here. `ropescope evaluate` prints how often promises are kept.

use super::estimates::StretchEstimate;

/// Error over stated deviation, quantity by quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ErrorRatios {
    strand_lay: f64,
    strand_phase: f64,
    wire_lay: f64,
    wire_phase: f64,
    /// Of the diameter over all directions.
    pub diameter: f64,
}

/// Several views of a rope in ordinary lay: what four registrations err by cancels better than is guessed.
const ORDINARY: ErrorRatios =
    ErrorRatios { strand_lay: 0.79, strand_phase: 0.84, wire_lay: 0.9, wire_phase: 0.95, diameter: 0.92 };
/// Several views of a rope in Lang lay: its wires run aslant, so that a strand that is registered too far on takes them along in all views.
const LANG: ErrorRatios =
    ErrorRatios { strand_lay: 1.03, strand_phase: 0.93, wire_lay: 1.0, wire_phase: 1.0, diameter: 0.92 };
/// One view: its wires are out of sight between their passes for longer than their courses are sure.
const ONE_VIEW: ErrorRatios =
    ErrorRatios { strand_lay: 1.05, strand_phase: 1.0, wire_lay: 1.0, wire_phase: 1.2, diameter: 1.0 };

impl ErrorRatios {
    /// Those of a rope that so many cameras look at, with the wires laid against its strands or with them.
    pub fn of(cameras: usize, ordinary: bool) -> Self {
        match (cameras, ordinary) {
            (1, _) => ONE_VIEW,
            (_, true) => ORDINARY,
            (_, false) => LANG,
        }
    }

    /// Makes the stated deviations those of the errors.
    pub fn make_good(&self, estimate: &mut StretchEstimate) {
        if let Some(strand) = &mut estimate.strand {
            strand.lay_sd_mm *= self.strand_lay;
            strand.phase_sd_rad *= self.strand_phase;
        }
        for wire in estimate.wires.iter_mut().flatten() {
            wire.lay_sd_mm *= self.wire_lay;
            wire.phase_sd_rad *= self.wire_phase;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::estimates::LayEstimate;

    #[test]
    fn every_deviation_is_made_good_by_its_own_ratio() {
        let of = |lay_mm| Some(LayEstimate { lay_mm, lay_sd_mm: 2.0, phase_rad: 0.0, phase_sd_rad: 3.0, score: 1.0 });
        let mut told = StretchEstimate { strand: of(220.0), wires: vec![of(-95.0), None, of(-96.0)] };
        ErrorRatios::of(4, true).make_good(&mut told);
        let strand = told.strand.unwrap();
        assert_eq!((strand.lay_sd_mm, strand.phase_sd_rad), (2.0 * ORDINARY.strand_lay, 3.0 * ORDINARY.strand_phase));
        let wires = (2.0 * ORDINARY.wire_lay, 3.0 * ORDINARY.wire_phase);
        assert!(told.wires.iter().flatten().all(|wire| (wire.lay_sd_mm, wire.phase_sd_rad) == wires));
        assert_eq!(strand.lay_mm, 220.0);
    }

    #[test]
    fn ropes_are_told_apart_by_their_lay_and_their_cameras() {
        assert_eq!([ErrorRatios::of(4, true), ErrorRatios::of(2, false)], [ORDINARY, LANG]);
        assert_eq!([ErrorRatios::of(1, true), ErrorRatios::of(1, false)], [ONE_VIEW; 2]);
    }
}
