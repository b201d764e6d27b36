//! Scores of a stretch in one view: of every cell of the unrolled rope, and of every block along it.

use super::filtering::TOGETHER;
use super::kind::Likely;
use super::wide::wide;
use rayon::prelude::*;
use std::ops::Range;

/// What another view's score counts where this view sees the place well, but does not judge it as high.
const OTHER_VIEW_SHARE: f32 = 0.95;
/// What a closer look of another view adds to that of this one: two pictures of one place tell more than one, but not twice as much,
/// for what lies there looks alike in both.
const OTHER_LOOK_SHARE: f32 = 0.5;
/// Blocks to either side that a block's score is settled with.
const SETTLING_BLOCKS: usize = 10;
/// Share of that mean in the settled score.
const SETTLING_SHARE: f32 = 0.5;
/// What factors count at the most beside a closer look: beyond, foreign matter is as rare on intact rope as damage.
const MOST_OF_FACTORS: f32 = 6.0;

/// A part of every score, the rest of the mean about it where that is lower: the highest of many places jumps from block to block by
/// chance, defects last. Rope beside a defect does not become one.
fn settled(blocks: &[f32]) -> Vec<f32> {
    let around = |k: usize| {
        let near = &blocks[k.saturating_sub(SETTLING_BLOCKS)..(k + SETTLING_BLOCKS + 1).min(blocks.len())];
        let (sum, n) = near.iter().filter(|s| s.is_finite()).fold((0.0, 0.0), |(s, n), b| (s + b, n + 1.0));
        sum / n
    };
    blocks.iter().enumerate().map(|(k, &score)| score + SETTLING_SHARE * (around(k) - score).min(0.0)).collect()
}

/// How well a view sees a place: in a byte, for there are millions while thresholds are sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
pub struct Visibility(u8);

impl Visibility {
    /// As well as a place that faces the camera.
    pub const WHOLE: Self = Self(u8::MAX);

    /// A share of that, from 0, not at all, to 1.
    #[inline(always)]
    pub fn new(share: f32) -> Self {
        Self((share * f32::from(u8::MAX) + 0.5) as u8)
    }

    /// The share.
    #[inline(always)]
    pub fn share(self) -> f32 {
        f32::from(self.0) / f32::from(u8::MAX)
    }
}

/// What a closer look told of a segment of a wire.
#[derive(Debug, Clone, PartialEq)]
pub struct Looked {
    /// The blocks of the segment.
    pub blocks: Range<usize>,
    /// The strand.
    pub strand: usize,
    /// What it adds to the scores.
    pub added: f32,
    /// What its damage looks like.
    pub likely: Likely,
}

/// The highest place of a strand in a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The strand.
    pub strand: usize,
    /// The place among those of the strand.
    pub place: usize,
    /// What the block scores there.
    pub score: f32,
}

/// Scores of a stretch in one view.
#[derive(Debug, Clone)]
pub struct StretchScores {
    /// Score of every place, `[(block * strands + strand) * places + place]`; NaN where nothing was judged.
    pub cells: Vec<f32>,
    /// What a closer look adds to it, same order; empty where nobody looked closer.
    pub added: Vec<f32>,
    /// What damage was seen by a closer look, along the rope.
    pub looks: Vec<Looked>,
    /// How well this view sees it, same order.
    pub visibility: Vec<Visibility>,
    /// Score of every block: the highest of its places, settled with the blocks about it; NaN where nothing was judged.
    pub blocks: Vec<f32>,
    /// Strand and place where that highest score stands.
    pub peaks: Vec<(usize, usize)>,
    /// Lines per block.
    pub block_lines: usize,
    /// Places per strand.
    pub places: usize,
}

impl StretchScores {
    /// From the scores of cells and how well they are seen, `row` of them a block.
    pub(super) fn new(
        cells: Vec<f32>,
        visibility: Vec<Visibility>,
        row: usize,
        places: usize,
        block_lines: usize,
    ) -> Self {
        let (added, looks) = (Vec::new(), Vec::new());
        let mut scores =
            Self { cells, added, looks, visibility, blocks: Vec::new(), peaks: Vec::new(), block_lines, places };
        scores.find_peaks(row);
        scores
    }

    /// Highest score of every block's own places; NaN where nothing was judged.
    pub fn highest(&self) -> Vec<f32> {
        let row = self.cells.len() / self.peaks.len().max(1);
        let at = |(block, &(strand, place)): (usize, &(usize, usize))| {
            self.cells[block * row + strand * self.places + place]
        };
        self.peaks.iter().enumerate().map(at).collect()
    }

    /// The peak of a block, then those of other strands, of all that score over a threshold. What lowers a block for being alone lowers them,
    /// too; what lasts on the strand of the peak raises no other.
    pub fn peaks_over(&self, block: usize, threshold: f64) -> Vec<Peak> {
        let (strand, place) = self.peaks[block];
        let row = self.cells.len() / self.peaks.len().max(1);
        let cells = &self.cells[block * row..(block + 1) * row];
        let highest = Peak { strand, place, score: self.blocks[block] };
        let lowered = cells.get(strand * self.places + place).map_or(0.0, |top| (top - highest.score).max(0.0));
        let others = cells.chunks_exact(self.places).enumerate().filter(|&(other, _)| other != strand);
        let others = others.filter_map(|(strand, cells)| {
            let known = cells.iter().copied().enumerate().filter(|(_, score)| !score.is_nan());
            let (place, score) = known.max_by(|a, b| a.1.total_cmp(&b.1))?;
            Some(Peak { strand, place, score: score - lowered })
        });
        std::iter::once(highest).chain(others).filter(|peak| f64::from(peak.score) > threshold).collect()
    }

    /// Adds what the closer look found to what factors found, once that of all views was joined and is as high as it lasts.
    pub fn add_closer_look(&mut self) {
        if self.added.is_empty() {
            return;
        }
        for (cell, added) in self.cells.iter_mut().zip(&self.added) {
            // Not `min`, which takes the number where the other is NaN.
            *cell = if *cell > MOST_OF_FACTORS { MOST_OF_FACTORS } else { *cell } + added;
        }
        let row = self.cells.len() / self.peaks.len().max(1);
        let blocks = self.blocks.iter_mut().zip(&mut self.peaks);
        for ((score, peak), (cells, added)) in
            blocks.zip(self.cells.chunks_exact(row).zip(self.added.chunks_exact(row)))
        {
            let most = added.iter().copied().fold(0.0, f32::max);
            *score = if *score > MOST_OF_FACTORS { MOST_OF_FACTORS } else { *score } + most;
            if most > 0.0 {
                let highest = (0..row).filter(|&at| !cells[at].is_nan()).max_by(|&a, &b| cells[a].total_cmp(&cells[b]));
                *peak = highest.map_or(*peak, |at| (at / self.places, at % self.places));
            }
        }
    }

    /// What the damage of a strand in a block looks like: what was told of its wires there, each by what it adds.
    pub fn likely(&self, block: usize, strand: usize) -> Likely {
        let here = self.looks.iter().filter(|looked| looked.strand == strand && looked.blocks.contains(&block));
        here.fold(Likely::default(), |sum, looked| sum.joined(&looked.likely.times(f64::from(looked.added))))
    }

    /// The highest score of any view counts in this one.
    #[inline(always)]
    fn take_over_cells(&mut self, best: &[f32]) {
        for ((score, &visibility), &best) in self.cells.iter_mut().zip(&self.visibility).zip(best) {
            if visibility > Visibility::new(0.0) && best.is_finite() {
                *score = score.max(visibility.share() * OTHER_VIEW_SHARE * best);
            }
        }
    }

    /// What closer looks add is a logarithm of odds: that of this view and a share of the highest of the others.
    #[inline(always)]
    fn take_over_looks(&mut self, highest: &[[f32; 2]]) {
        for ((added, &visibility), &[first, second]) in self.added.iter_mut().zip(&self.visibility).zip(highest) {
            let of_others = if *added == first { second } else { first };
            *added += visibility.share() * OTHER_LOOK_SHARE * of_others;
        }
    }

    #[inline(always)]
    fn find_peaks(&mut self, row: usize) {
        self.blocks.clear();
        self.peaks.clear();
        for block in self.cells.chunks_exact(row) {
            // The highest of several columns side by side, then where it stands. NaN is never higher.
            let mut columns = [f32::NEG_INFINITY; TOGETHER];
            for scores in block.chunks(TOGETHER) {
                for (best, &score) in columns.iter_mut().zip(scores) {
                    *best = if score > *best { score } else { *best };
                }
            }
            let best = columns.into_iter().fold(f32::NEG_INFINITY, f32::max);
            let peak = block.iter().rposition(|&score| score == best).unwrap_or(0);
            self.blocks.push(if best.is_finite() { best } else { f32::NAN });
            self.peaks.push((peak / self.places, peak % self.places));
        }
        self.blocks = settled(&self.blocks);
    }
}

/// Joins what several views say of the same places: each view takes over what another one scores higher, as far as it sees the
/// place itself. A break at the edge of one view is often in the middle of the next.
pub fn join_views(views: &mut [Option<StretchScores>], strands: usize) {
    let (best, highest) = rayon::join(|| best_cells(views), || highest_looks(views));
    views.par_iter_mut().flatten().for_each(|view| {
        wide(
            #[inline(always)]
            || {
                view.take_over_cells(&best);
                view.take_over_looks(&highest);
                view.find_peaks(strands * view.places);
            },
        );
    });
}

/// The highest score that any view gives a place; NaN where none does.
fn best_cells(views: &[Option<StretchScores>]) -> Vec<f32> {
    let mut best: Vec<f32> = Vec::new();
    for view in views.iter().flatten() {
        best.resize(best.len().max(view.cells.len()), f32::NAN);
        wide(
            #[inline(always)]
            // Takes the number where the other is NaN.
            || best.iter_mut().zip(&view.cells).for_each(|(best, &score)| *best = best.max(score)),
        );
    }
    best
}

/// The two highest that closer looks of any views add at a place.
fn highest_looks(views: &[Option<StretchScores>]) -> Vec<[f32; 2]> {
    let mut highest: Vec<[f32; 2]> = Vec::new();
    for view in views.iter().flatten() {
        highest.resize(highest.len().max(view.added.len()), [0.0; 2]);
        for (highest, &added) in highest.iter_mut().zip(&view.added) {
            *highest = if added > highest[0] { [added, highest[0]] } else { [highest[0], highest[1].max(added)] };
        }
    }
    highest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One strand of four places, of which the second has the scores; the others score 0.
    fn stretch(scores: &[f32]) -> StretchScores {
        let cells: Vec<f32> = scores.iter().flat_map(|&score| [0.0, score, 0.0, 0.0]).collect();
        StretchScores::new(cells.clone(), vec![Visibility::WHOLE; cells.len()], 4, 4, 5)
    }

    #[test]
    fn a_jump_is_lowered_more_than_what_lasts_and_rope_beside_a_defect_stays_as_it_is() {
        let alone: Vec<f32> = (0..100).map(|block| if block == 50 { 8.0 } else { 1.0 }).collect();
        let lasting: Vec<f32> = (0..100).map(|block| if (40..60).contains(&block) { 8.0 } else { 1.0 }).collect();
        let (alone, lasting) = (stretch(&alone), stretch(&lasting));
        assert!(alone.blocks[50] < 5.5, "{}", alone.blocks[50]);
        assert!(lasting.blocks[50] > 7.5, "{}", lasting.blocks[50]);
        for beside in [38, 39, 60, 61] {
            assert_eq!(lasting.blocks[beside], 1.0);
        }
        assert_eq!((lasting.peaks[50], lasting.highest()[50]), ((0, 1), 8.0));
    }

    #[test]
    fn a_view_takes_over_what_another_one_scores_higher_as_far_as_it_sees_the_place() {
        let (mut low, high) = (stretch(&[1.0; 30]), stretch(&[6.0; 30]));
        (low.visibility[4 * 10 + 1], low.visibility[4 * 11 + 1]) = (Visibility::new(0.0), Visibility::new(0.2));
        let mut views = [Some(low), None, Some(high)];
        join_views(&mut views, 1);
        let low = views[0].as_ref().unwrap();
        assert_eq!(low.cells[4 * 9 + 1], OTHER_VIEW_SHARE * 6.0);
        assert_eq!(low.cells[4 * 10 + 1], 1.0);
        assert_eq!(low.cells[4 * 11 + 1], 0.2 * OTHER_VIEW_SHARE * 6.0, "hardly seen, it counts little");
        assert_eq!(views[2].as_ref().unwrap().cells[4 * 9 + 1], 6.0);
    }

    #[test]
    fn closer_looks_of_two_views_add_up_and_one_counts_half_in_the_other() {
        let looked = |added: [f32; 4]| StretchScores { added: added.to_vec(), ..stretch(&[3.0]) };
        let mut views =
            [Some(looked([8.0, 0.0, 4.0, 6.0])), None, Some(looked([2.0, 6.0, 4.0, 0.0])), Some(stretch(&[3.0]))];
        let visibility = &mut views[2].as_mut().unwrap().visibility;
        (visibility[0], visibility[3]) = (Visibility::new(0.6), Visibility::new(0.0));
        join_views(&mut views, 1);
        assert_eq!(views[0].as_ref().unwrap().added, [9.0, 3.0, 6.0, 6.0]);
        assert_eq!(views[2].as_ref().unwrap().added, [2.0 + 0.6 * 4.0, 6.0, 6.0, 0.0], "as far as it sees the place");
        assert!(views[3].as_ref().unwrap().added.is_empty(), "nobody looked closer there");
    }

    #[test]
    fn a_closer_look_decides_where_factors_are_no_longer_believed() {
        let mut scores = stretch(&[1.0, 4.0, 20.0, 20.0, f32::NAN]);
        let unchanged = scores.clone();
        scores.add_closer_look();
        assert_eq!(scores.cells.len(), unchanged.cells.len(), "nobody looked closer");
        assert_eq!(scores.blocks[..4], unchanged.blocks[..4]);
        scores.added = vec![0.0; scores.cells.len()];
        scores.added[4 * 3 + 2] = 8.0;
        scores.add_closer_look();
        assert_eq!((scores.cells[4 * 2 + 1], scores.cells[4 * 3 + 1], scores.cells[4 + 1]), (6.0, 6.0, 4.0));
        assert_eq!((scores.peaks[2], scores.peaks[3]), ((0, 1), (0, 2)), "where the sum is highest");
        assert!(scores.blocks[3] - scores.blocks[2] > 7.9 && scores.cells[4 * 4 + 1].is_nan());
    }

    #[test]
    fn every_strand_over_a_threshold_has_a_peak_and_what_lasts_on_one_raises_no_other() {
        // Two strands of two places.
        let scores = |block: f32| StretchScores {
            cells: vec![7.0, 20.0, 13.0, f32::NAN],
            blocks: vec![block],
            peaks: vec![(0, 1)],
            places: 2,
            ..stretch(&[])
        };
        let peak = |strand, place, score| Peak { strand, place, score };
        assert_eq!(scores(20.0).peaks_over(0, 12.0), [peak(0, 1, 20.0), peak(1, 0, 13.0)]);
        assert_eq!(scores(20.0).peaks_over(0, 13.0), [peak(0, 1, 20.0)]);
        assert_eq!(scores(17.0).peaks_over(0, 9.0), [peak(0, 1, 17.0), peak(1, 0, 10.0)], "lowered alike");
        assert_eq!(scores(31.0).peaks_over(0, 14.0), [peak(0, 1, 31.0)], "raised alone");
    }

    #[test]
    fn blocks_that_nobody_judged_have_no_score_and_lower_nobody() {
        let mut cells = vec![f32::NAN; 4 * 40];
        cells[..4 * 20].fill(3.0);
        let scores = StretchScores::new(cells, vec![Visibility::WHOLE; 4 * 40], 4, 4, 5);
        assert!(scores.blocks[..20].iter().all(|&score| score == 3.0));
        assert!(scores.blocks[20..].iter().all(|score| score.is_nan()));
        assert!(StretchScores::new(Vec::new(), Vec::new(), 1, 1, 1).blocks.is_empty());
    }
}
