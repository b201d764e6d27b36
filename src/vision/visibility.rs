//! How well a view sees the places of the unrolled rope.

use super::evidence::Evidence;
use super::filter_rows::Rows;
use super::filtering::half_blocks;
use super::stretch_scores::Visibility;
use super::wide::wide;
use std::ops::Range;

/// Reach about a place within which pixels make it seen: mm along the rope, and places across, which make 1.4 wires.
const SEEN_WITHIN: (f64, usize) = (4.0, 3);
/// Share of the pixels that places have which face the camera, from which on a place is seen as well as these.
const SEEN_WELL: f32 = 0.3;
/// How well a place is seen that the view hardly sees.
const HARDLY_SEEN: f32 = 0.25;

impl Evidence {
    /// How well places are seen, in the order of scores, from 0, where no pixel fell near or lines were lost, to 1, where as many fell near as
    /// make little difference to a place that faces the camera.
    pub fn visibility(&self, pitch_mm: f64) -> Vec<Visibility> {
        let half = half_blocks(SEEN_WITHIN.0, self.block_lines as f64 * pitch_mm);
        let mut near = vec![0.0f32; self.counts.len()];
        let mut pixels = Rows::default();
        let mut under = vec![0.0f32; self.row()];
        let mut most = 0.0f32;
        for (strand, blocks) in self.passes(2 * half + 1) {
            let about = blocks.start.saturating_sub(half)..(blocks.end + half).min(self.blocks);
            let counts = |at: Range<usize>, to: &mut [f32]| to.copy_from_slice(&self.counts[at]);
            pixels.across::<{ SEEN_WITHIN.1 }>(self, strand, about.clone(), counts);
            for block in about.clone() {
                pixels.within(&pixels.about(block - about.start, half), &mut under);
                most = under.iter().copied().fold(most, f32::max);
                if !self.lost[block] {
                    near[self.of_scores(block, strand)].copy_from_slice(&under[..self.places]);
                }
            }
        }
        let enough = SEEN_WELL * most;
        let share = |n: f32| if n > 0.0 { HARDLY_SEEN + (1.0 - HARDLY_SEEN) * (n / enough).min(1.0) } else { 0.0 };
        wide(
            #[inline(always)]
            || near.into_iter().map(|n| Visibility::new(share(n))).collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::filtering::tests::{BLOCKS, PITCH_MM, evidence};
    use super::*;

    #[test]
    fn a_place_is_seen_when_pixels_fell_near_it_and_the_better_the_more_there_are() {
        let evidence = evidence();
        let visibility = evidence.visibility(PITCH_MM);
        let at = |block: usize, place: usize| visibility[evidence.of_scores(block, 0).start + place].share();
        // Four blocks before the first, three places beside the last; not beyond.
        assert!(at(16, 0) > 0.0 && at(20, 14) > 0.0 && at(93, 22) > 0.0);
        assert!(at(15, 0) == 0.0 && at(20, 15) == 0.0 && at(94, 22) == 0.0 && at(100, 0) == 0.0);
        let in_the_middle = at(60, 4);
        assert!(in_the_middle == 1.0 && at(16, 0) < 0.6, "{in_the_middle} {}", at(16, 0));
        assert!(
            visibility
                .iter()
                .map(|visibility| visibility.share())
                .all(|share| share == 0.0 || (HARDLY_SEEN - 0.01..=1.0).contains(&share))
        );
        assert!(
            (0..BLOCKS).all(|block| visibility[evidence.of_scores(block, 1)]
                .iter()
                .all(|visibility| visibility.share() == 0.0))
        );
    }
}
