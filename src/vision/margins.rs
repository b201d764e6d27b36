//! The ends of the stretches before and after one: what lies across a cut is judged as a whole.
//!
//! A stretch is as long as memory and the wait for results allow, 200 mm, and filters, patches and means reach 12 mm about a place. Without
//! its neighbours an eighth of all rope would be judged by half of what is about it.

use super::evidence::Evidence;
use super::inspection_model::Seen;
use super::stretch_scores::StretchScores;
use super::unrolled::Unrolled;

/// Blocks of either neighbour that a stretch is judged with: as far as the longest filter and the settling of scores reach together.
pub const MARGIN_BLOCKS: usize = 24;

/// A table `[(strand * blocks + block) * places + place]`, by its numbers of blocks and places.
#[derive(Clone, Copy)]
struct Shape {
    blocks: usize,
    places: usize,
}

/// Copies the same number of blocks of every strand from one table to another.
fn copy<T: Copy>(to: &mut [T], from: &[T], shapes: (Shape, Shape), first: (usize, usize), count: usize) {
    let strand = |shape: Shape| shape.blocks * shape.places;
    let blocks = |shape: Shape, first: usize| first * shape.places..(first + count) * shape.places;
    for (to, from) in to.chunks_exact_mut(strand(shapes.0)).zip(from.chunks_exact(strand(shapes.1))) {
        to[blocks(shapes.0, first.0)].copy_from_slice(&from[blocks(shapes.1, first.1)]);
    }
}

impl Evidence {
    fn copy_blocks(&mut self, from: &Self, first: (usize, usize), count: usize) {
        let shape = |of: &Self| Shape { blocks: of.blocks, places: of.places };
        let shapes = (shape(self), shape(from));
        for (to, from) in self.factors.iter_mut().zip(&from.factors) {
            copy(&mut to.sums, &from.sums, shapes, first, count);
        }
        copy(&mut self.counts, &from.counts, shapes, first, count);
        copy(&mut self.regions, &from.regions, shapes, first, count);
        self.lost[first.0..first.0 + count].copy_from_slice(&from.lost[first.1..first.1 + count]);
    }
}

impl Unrolled {
    fn copy_blocks(&mut self, from: &Self, first: (usize, usize), count: usize) {
        let shape = |of: &Self| Shape { blocks: of.blocks, places: of.places };
        let shapes = (shape(self), shape(from));
        copy(&mut self.deviation, &from.deviation, shapes, first, count);
        copy(&mut self.expected, &from.expected, shapes, first, count);
    }
}

impl Seen {
    /// Blocks of the stretch and of both margins.
    fn blocks(&self) -> usize {
        self.unrolled.blocks()
    }

    fn copy_blocks(&mut self, from: &Self, first: (usize, usize), count: usize) {
        self.evidence.copy_blocks(&from.evidence, first, count);
        self.unrolled.copy_blocks(&from.unrolled, first, count);
    }

    /// Fills the margin before the stretch with the end of the one before it, and the margin after that one with this one's beginning.
    /// Both have the same margins.
    pub fn follows(&mut self, before: &mut Self) {
        let margin = self.margin_blocks;
        let end_of_before = before.blocks() - margin;
        let count = margin.min(end_of_before - margin);
        self.copy_blocks(before, (margin - count, end_of_before - count), count);
        let count = margin.min(self.blocks() - 2 * margin);
        before.copy_blocks(self, (end_of_before, margin), count);
    }
}

/// Fills the margins between two stretches that follow each other, in all views that see both.
pub fn fill_between(before: &mut [Option<Seen>], after: &mut [Option<Seen>]) {
    for views in before.iter_mut().zip(after) {
        if let (Some(before), Some(after)) = views {
            after.follows(before);
        }
    }
}

impl StretchScores {
    /// Leaves the stretch itself.
    pub fn cut_margins(&mut self, margin_blocks: usize) {
        let row = self.cells.len() / self.blocks.len().max(1);
        fn cut<T>(table: &mut Vec<T>, margin: usize) {
            table.truncate(table.len().saturating_sub(margin));
            table.drain(..margin.min(table.len()));
        }
        for looked in &mut self.looks {
            looked.blocks = looked.blocks.start - margin_blocks..looked.blocks.end - margin_blocks;
        }
        cut(&mut self.cells, margin_blocks * row);
        cut(&mut self.added, margin_blocks * row);
        cut(&mut self.visibility, margin_blocks * row);
        cut(&mut self.blocks, margin_blocks);
        cut(&mut self.peaks, margin_blocks);
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::vision::evidence::GRAY;
    use crate::vision::stretch_scores::Visibility;
    use crate::vision::surface_map::PLACES_PER_WIRE;
    use crate::vision::unrolled::{FINE_PER_WIRE, GraySums};

    const STRANDS: usize = 2;
    const WIRES: usize = 5;

    /// A stretch whose blocks say `from`, `from + 1`, ... on every strand.
    pub(crate) fn seen(from: usize, blocks: usize) -> Seen {
        let all = blocks + 2 * MARGIN_BLOCKS;
        let mut evidence = Evidence::empty(5, all, STRANDS, WIRES * PLACES_PER_WIRE);
        let mut unrolled = Unrolled::unseen(all, STRANDS, WIRES);
        for (block, strand) in (0..blocks).flat_map(|block| (0..STRANDS).map(move |strand| (block, strand))) {
            for at in evidence.of(MARGIN_BLOCKS + block, strand) {
                evidence.set(at, (from + block) as f32, 1.0, strand as u8);
            }
            let gray = GraySums { deviation: (from + block) as f32 / 8.0, expected: 4.0, pixels: 1.0 };
            unrolled.take(MARGIN_BLOCKS + block, strand, &mut [gray; WIRES * FINE_PER_WIRE]);
        }
        Seen { evidence, unrolled, margin_blocks: MARGIN_BLOCKS }
    }

    /// What every block says, of the last place of a strand; `None` where nothing is seen.
    pub(crate) fn says(seen: &Seen, strand: usize) -> Vec<Option<f32>> {
        let evidence = &seen.evidence;
        let last = |block: usize| evidence.of(block, strand).end - 1;
        (0..evidence.blocks)
            .map(|b| (evidence.counts[last(b)] > 0.0).then(|| evidence.factors[GRAY].sums[last(b)]))
            .collect()
    }

    #[test]
    fn two_stretches_see_each_others_ends() {
        let (mut before, mut after) = (seen(0, 60), seen(60, 40));
        after.follows(&mut before);
        for strand in 0..STRANDS {
            let expected = |range: std::ops::Range<usize>| range.map(|block| Some(block as f32));
            let nothing = [None; MARGIN_BLOCKS];
            let of_before: Vec<_> = nothing.into_iter().chain(expected(0..60 + MARGIN_BLOCKS)).collect();
            let of_after: Vec<_> = expected(60 - MARGIN_BLOCKS..100).chain(nothing).collect();
            assert_eq!((says(&before, strand), says(&after, strand)), (of_before, of_after));
            let gray = after.unrolled.gray(0, strand, WIRES * FINE_PER_WIRE - 1).unwrap();
            assert!((gray.deviation - (60 - MARGIN_BLOCKS) as f32 / 8.0).abs() < 0.1, "{gray:?}");
        }
    }

    #[test]
    fn of_a_short_neighbour_there_is_as_much_as_it_has() {
        let (mut before, mut after) = (seen(0, 7), seen(7, 3));
        after.follows(&mut before);
        let known = |seen: &Seen| says(seen, 1).into_iter().flatten().collect::<Vec<_>>();
        assert_eq!(known(&before), (0..10).map(|block| block as f32).collect::<Vec<_>>());
        assert_eq!(known(&after), known(&before));
        assert_eq!(says(&after, 1)[MARGIN_BLOCKS - 1], Some(6.0), "side by side");
    }

    #[test]
    fn without_margins_the_stretch_is_left() {
        let blocks = 2 * MARGIN_BLOCKS + 3;
        let cells: Vec<f32> = (0..2 * blocks).map(|at| at as f32).collect();
        let mut scores = StretchScores::new(cells, vec![Visibility::WHOLE; 2 * blocks], 2, 1, 5);
        scores.cut_margins(MARGIN_BLOCKS);
        let first = 2.0 * MARGIN_BLOCKS as f32;
        assert_eq!(scores.cells, (0..6).map(|at| first + at as f32).collect::<Vec<_>>());
        assert_eq!(
            (scores.blocks.len(), scores.peaks.len(), scores.visibility.len(), scores.added.len()),
            (3, 3, 6, 0)
        );
    }
}
