//! A closer look at what factors found: is it damage, or does something lie on the rope? [extends Wacker13, sec. 5]
//!
//! What all factors say of single places picks the suspects, one in some 3 mm of every wire at the most; for each of these the patch
//! about it decides how high it scores. So the network looks at a thousandth of the rope, and what nobody suspects costs nothing. Where it
//! is in some doubt, another one looks at the image itself, whose details a patch does not show.

use super::damage::Network;
use super::detail::Details;
use super::detail_network::DetailNetwork;
use super::inspection_model::Seen;
use super::patch::Patch;
use super::stretch_scores::{Looked, StretchScores};
use super::surface_map::PLACES_PER_WIRE;
use std::ops::Range;

/// Score from which on a place is a suspect; what is below stays as it is.
pub const SUSPECT: f32 = 2.5;
/// Farthest that lines may be apart in mm: coarser pictures, such as previews, do not show what the network has learnt to look at.
pub const COARSEST_MM: f64 = 0.25;
/// Blocks of a wire that have one suspect at the most.
pub const SEGMENT_BLOCKS: usize = 6;
/// Score and logarithm of the odds of a patch from which on the image itself is looked at: 99 % of the suspects on simulated burns have these
/// odds, 92 % both, and 30 % of all suspects of the labelled sample.
pub const DOUBTFUL: (f32, f32) = (3.0, -4.0);
/// Blocks to either side of a suspect that a burn which is seen there counts for.
const BURN_BLOCKS: usize = 3;
/// Logarithm of the odds at which the closer look begins to count.
const LEAST_LOG_ODDS: f32 = -3.0;

/// The place of a wire that scores highest within a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suspect {
    /// Its block.
    pub block: usize,
    /// Its strand.
    pub strand: usize,
    /// Its place among those of the strand.
    pub place: usize,
    /// Its score.
    pub score: f32,
    /// First block of the segment.
    segment: usize,
}

impl Suspect {
    /// Its wire.
    pub fn wire(&self) -> usize {
        self.place / PLACES_PER_WIRE
    }

    /// Blocks that what is told of it counts for, among those that are judged, and the least score of their places: those of its segment that
    /// are as suspicious, or, as factors do not tell how far a burn goes, all that are near.
    fn counts_for(&self, burn: bool, judged: Range<usize>) -> (Range<usize>, f32) {
        if burn {
            let near = self.block.saturating_sub(BURN_BLOCKS)..self.block + BURN_BLOCKS + 1;
            return (near.start.max(judged.start)..near.end.min(judged.end), f32::NEG_INFINITY);
        }
        (self.segment..(self.segment + SEGMENT_BLOCKS).min(judged.end), SUSPECT)
    }
}

/// The suspects of a stretch, along the rope, but for those in its margins.
pub fn suspects(scores: &StretchScores, strands: usize, margin_blocks: usize) -> Vec<Suspect> {
    let row = strands * scores.places;
    let end = (scores.cells.len() / row.max(1)).saturating_sub(margin_blocks);
    let mut suspects = Vec::new();
    for segment in (margin_blocks..end).step_by(SEGMENT_BLOCKS) {
        for first in (0..row).step_by(PLACES_PER_WIRE) {
            let mut best: Option<Suspect> = None;
            for block in segment..(segment + SEGMENT_BLOCKS).min(end) {
                let cells = &scores.cells[block * row + first..block * row + first + PLACES_PER_WIRE];
                for (at, &score) in (first..).zip(cells) {
                    if score >= best.map_or(SUSPECT, |best| best.score.next_up()) {
                        best = Some(Suspect {
                            block,
                            strand: at / scores.places,
                            place: at % scores.places,
                            score,
                            segment,
                        });
                    }
                }
            }
            suspects.extend(best);
        }
    }
    suspects
}

/// What the closer look adds to a score: logarithms of odds, as findings are logarithms of rarity, where they speak for damage, and
/// hardly anything where they speak against it.
fn adds(log_odds: f32) -> f32 {
    let above = log_odds - LEAST_LOG_ODDS;
    // ln(1 + e^x), which is x where x is large.
    above.max(0.0) + (-above.abs()).exp().ln_1p()
}

/// Looks at all suspects of a stretch, and adds what it says to the suspicious places of their segments, or to all that are about a burn.
pub fn look_closer(scores: &mut StretchScores, seen: &Seen, mut details: Details<'_>, strands: usize) {
    let (network, of_details) = (Network::trained(), DetailNetwork::trained());
    let mut patch = Patch::default();
    let row = strands * scores.places;
    let end = seen.unrolled.blocks() - seen.margin_blocks;
    let (mut added, mut looks) = (vec![0.0; scores.cells.len()], Vec::new());
    for suspect in suspects(scores, strands, seen.margin_blocks) {
        patch.cut(&seen.unrolled, &seen.evidence, suspect.block, suspect.strand, suspect.wire());
        let mut told = network.look(&patch, suspect.score);
        if suspect.score >= DOUBTFUL.0 && told.log_odds >= DOUBTFUL.1 {
            let block = suspect.block - seen.margin_blocks;
            if let Some(detail) = details.about(block, suspect.strand, suspect.place) {
                told = of_details.look(detail, told, suspect.score);
            }
        }
        let more = adds(told.log_odds);
        let first = suspect.strand * scores.places + suspect.wire() * PLACES_PER_WIRE;
        let (blocks, least) = suspect.counts_for(told.burn, seen.margin_blocks..end);
        for block in blocks.clone() {
            let places = block * row + first..block * row + first + PLACES_PER_WIRE;
            for (added, cell) in added[places.clone()].iter_mut().zip(&scores.cells[places]) {
                if *cell >= least {
                    *added = more.max(*added);
                }
            }
        }
        looks.push(Looked { blocks, strand: suspect.strand, added: more, likely: told.likely });
    }
    (scores.added, scores.looks) = (added, looks);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::stretch_scores::Visibility;

    #[test]
    fn the_highest_place_of_three_millimetres_of_a_wire_is_the_suspect() {
        let (strands, places, blocks) = (2, 3 * PLACES_PER_WIRE, 14);
        let mut cells = vec![1.0; blocks * strands * places];
        let mut set = |block: usize, strand: usize, place: usize, score: f32| {
            cells[(block * strands + strand) * places + place] = score;
        };
        set(2, 1, 6, 4.0);
        set(4, 1, 9, 5.0); // the same wire and segment
        set(6, 1, 9, 3.0); // the next segment
        set(4, 0, 9, 2.4); // too low
        set(13, 0, 0, f32::NAN);
        let scores =
            StretchScores::new(cells, vec![Visibility::WHOLE; blocks * strands * places], strands * places, places, 5);
        let found: Vec<_> =
            suspects(&scores, strands, 0).iter().map(|s| (s.block, s.strand, s.place, s.score)).collect();
        assert_eq!(found, [(4, 1, 9, 5.0), (6, 1, 9, 3.0)]);
        let inner = suspects(&scores, strands, 3);
        assert_eq!(inner.iter().map(|s| s.block).collect::<Vec<_>>(), [4], "and none in the margins");
    }

    #[test]
    fn what_is_told_counts_for_a_segment_and_of_a_burn_for_what_is_near() {
        let counts_for = |block: usize, burn: bool| {
            Suspect { block, strand: 0, place: 0, score: 4.0, segment: 18 }.counts_for(burn, 5..22)
        };
        assert_eq!(counts_for(19, false), (18..22, SUSPECT), "no block of the margin");
        assert_eq!(counts_for(19, true), (16..22, f32::NEG_INFINITY), "factors do not tell how far it goes");
        assert_eq!(counts_for(6, true).0, 5..10);
    }

    #[test]
    fn scores_rise_with_the_odds_and_what_is_no_damage_keeps_its_own() {
        let added: Vec<f32> = (-40..30).map(|k| adds(k as f32 / 2.0)).collect();
        assert!(added.windows(2).all(|pair| pair[0] <= pair[1]) && added[0] >= 0.0 && added[0] < 1e-3);
        assert!((adds(5.0) - adds(4.0) - 1.0).abs() < 1e-3);
    }
}
