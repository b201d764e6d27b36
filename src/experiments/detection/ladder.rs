//! From the paper's configuration to ours, one part after the other. Each rung is trained, calibrated and given its threshold for
//! itself, by the same rope and the same budget.

use crate::pipeline::BandwidthsBy;
use crate::vision::appearance::GrayScore;
use crate::vision::judging::{Filters, Judging};
use crate::vision::mean_filter::MeanOf;

/// A configuration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rung {
    /// What it adds to the one before.
    pub name: &'static str,
    /// Who chooses the bandwidths of the gray density.
    pub bandwidths: BandwidthsBy,
    /// What the score of a gray value is.
    pub gray_score: GrayScore,
    /// What is made of it.
    pub judging: Judging,
}

/// The filter of the paper, by its number: 4 mm along one wire. A choice, the middle one of ours: the paper filters along the wire and
/// states no length.
const FILTER: usize = 1;

/// Gray values alone, under one filter, one view for itself.
const BARE: Judging = Judging {
    filters: Filters::Mean(FILTER, MeanOf::Likelihoods),
    joined: false,
    further: false,
    settled: false,
    lasting: false,
    closer_look: false,
};
const CALIBRATED: Judging = Judging { filters: Filters::Calibrated, ..BARE };
const JOINED: Judging = Judging { joined: true, ..CALIBRATED };
const FURTHER: Judging = Judging { further: true, ..JOINED };
const SETTLED: Judging = Judging { settled: true, ..FURTHER };
const LASTING: Judging = Judging { lasting: true, ..SETTLED };

/// The paper's: its density, its normalisation (eq. 18-22), its mean filter.
const PAPER: Rung =
    Rung { name: "the paper's", bandwidths: BandwidthsBy::Fixed, gray_score: GrayScore::Likelihood, judging: BARE };

const LOGARITHMS: Rung = Rung {
    name: "logarithms, mean and spread of the region",
    gray_score: GrayScore::Surprise,
    judging: Judging { filters: Filters::Mean(FILTER, MeanOf::Surprises), ..BARE },
    ..PAPER
};

const HELD_OUT: Rung = Rung {
    name: "bandwidths by held-out likelihood",
    bandwidths: BandwidthsBy::HeldOut,
    judging: JOINED,
    ..LOGARITHMS
};

const fn with(name: &'static str, judging: Judging, before: Rung) -> Rung {
    Rung { name, judging, ..before }
}

/// From the paper's to ours; every one has what those before it have.
pub(super) const LADDER: [Rung; 9] = [
    PAPER,
    LOGARITHMS,
    with("three filters, calibrated", CALIBRATED, LOGARITHMS),
    with("views that see one place joined", JOINED, LOGARITHMS),
    HELD_OUT,
    with("further factors, weighed and added up", FURTHER, HELD_OUT),
    with("blocks judged with those about them", SETTLED, HELD_OUT),
    with("scores that last", LASTING, HELD_OUT),
    with("a closer look at what was found", Judging::WHOLE, HELD_OUT),
];

/// Ours.
pub(super) const OURS: Rung = LADDER[LADDER.len() - 1];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ladder_ends_with_what_inspections_have() {
        assert_eq!(OURS.judging, Judging::WHOLE);
        assert_eq!((OURS.bandwidths, OURS.gray_score), (BandwidthsBy::default(), GrayScore::Surprise));
    }

    #[test]
    fn every_rung_differs_from_the_one_before_and_keeps_all_but_one_part_of_it() {
        let parts = |rung: &Rung| {
            let j = rung.judging;
            let gray = (rung.gray_score == GrayScore::Surprise, j.filters == Filters::Calibrated);
            let bandwidths = rung.bandwidths == BandwidthsBy::HeldOut;
            [bandwidths, gray.0, gray.1, j.joined, j.further, j.settled, j.lasting, j.closer_look]
        };
        for pair in LADDER.windows(2) {
            let (before, after) = (parts(&pair[0]), parts(&pair[1]));
            let added = before.iter().zip(&after).filter(|(before, after)| !**before && **after).count();
            let taken = before.iter().zip(&after).filter(|(before, after)| **before && !**after).count();
            assert_eq!((added, taken), (1, 0), "{}", pair[1].name);
        }
    }
}
