//! Scores of a stretch in one view: of every cell of the unrolled rope, and of every block along it.

use super::filtering::TOGETHER;

/// What another view's score counts where this view sees the place, but too obliquely to judge as well.
const OTHER_VIEW_SHARE: f32 = 0.95;
/// Blocks to either side that a block's score is settled with.
const SETTLING_BLOCKS: usize = 10;
/// Share of that mean in the settled score.
const SETTLING_SHARE: f32 = 0.5;

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

/// Scores of a stretch in one view.
#[derive(Debug, Clone)]
pub struct StretchScores {
    /// Highest score under any filter, `[(block * strands + strand) * places + place]`; NaN where nothing was judged.
    pub cells: Vec<f32>,
    /// Whether any pixel of this view fell there, same order.
    pub seen: Vec<bool>,
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
    /// From the scores of cells and whether they are seen, `row` of them a block.
    pub(super) fn new(cells: Vec<f32>, seen: Vec<bool>, row: usize, places: usize, block_lines: usize) -> Self {
        let mut scores = Self { cells, seen, blocks: Vec::new(), peaks: Vec::new(), block_lines, places };
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

/// Joins what several views say of the same places: each view takes over what another one scores higher, where it sees the
/// place itself. A break at the edge of one view is often in the middle of the next.
pub fn join_views(views: &mut [Option<StretchScores>], strands: usize) {
    let Some(len) = views.iter().flatten().map(|v| v.cells.len()).max() else { return };
    let mut best = vec![f32::NAN; len];
    for view in views.iter().flatten() {
        for (best, &score) in best.iter_mut().zip(&view.cells) {
            *best = best.max(score);
        }
    }
    for view in views.iter_mut().flatten() {
        for ((cell, &seen), &best) in view.cells.iter_mut().zip(&view.seen).zip(&best) {
            if seen && best.is_finite() {
                *cell = cell.max(OTHER_VIEW_SHARE * best);
            }
        }
        let row = strands * view.places;
        view.find_peaks(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One strand of four places, of which the second has the scores; the others score 0.
    fn stretch(scores: &[f32]) -> StretchScores {
        let cells: Vec<f32> = scores.iter().flat_map(|&score| [0.0, score, 0.0, 0.0]).collect();
        StretchScores::new(cells.clone(), vec![true; cells.len()], 4, 4, 5)
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
    fn a_view_takes_over_what_another_one_scores_higher_where_it_sees_the_place() {
        let (mut low, high) = (stretch(&[1.0; 30]), stretch(&[6.0; 30]));
        low.seen[4 * 10 + 1] = false;
        let mut views = [Some(low), None, Some(high)];
        join_views(&mut views, 1);
        let low = views[0].as_ref().unwrap();
        assert_eq!(low.cells[4 * 9 + 1], OTHER_VIEW_SHARE * 6.0);
        assert_eq!(low.cells[4 * 10 + 1], 1.0);
        assert_eq!(views[2].as_ref().unwrap().cells[4 * 9 + 1], 6.0);
    }

    #[test]
    fn blocks_that_nobody_judged_have_no_score_and_lower_nobody() {
        let mut cells = vec![f32::NAN; 4 * 40];
        cells[..4 * 20].fill(3.0);
        let scores = StretchScores::new(cells, vec![true; 4 * 40], 4, 4, 5);
        assert!(scores.blocks[..20].iter().all(|&score| score == 3.0));
        assert!(scores.blocks[20..].iter().all(|score| score.is_nan()));
        assert!(StretchScores::new(Vec::new(), Vec::new(), 1, 1, 1).blocks.is_empty());
    }
}
