//! Rows of sums that filters along the wires are made of: across the wires first, then along the rope.

use super::evidence::Evidence;
use super::filtering::TOGETHER;
use super::wide::wide;
use std::array::from_fn;
use std::ops::Range;

/// Sums of one strand from its first block on: whatever lies between two blocks is the difference of two rows. Numbers of pixels are whole
/// and stay exact; scores, of which a pass has some ten thousand, are off by a thousandth.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    values: Vec<f32>,
    /// Values of a row.
    row: usize,
    /// Blocks that are summed; there is one row more.
    blocks: usize,
}

impl Rows {
    /// Sums over `HALF` places to either side of every place of a strand, and over all blocks before. `read` writes the values of the places of a
    /// row of the evidence; it is so small that it is inlined.
    pub fn across<const HALF: usize>(
        &mut self,
        evidence: &Evidence,
        strand: usize,
        blocks: Range<usize>,
        read: impl Fn(Range<usize>, &mut [f32]),
    ) {
        let (places, row) = (evidence.places, evidence.row());
        (self.row, self.blocks) = (row, blocks.len());
        self.values.resize((blocks.len() + 1) * row, 0.0);
        let mut cyclic = vec![0.0f32; row + 2 * HALF];
        wide(
            #[inline(always)]
            || {
                let (mut before, mut rows) = self.values.split_at_mut(row);
                before.fill(0.0);
                for block in blocks {
                    read(evidence.of(block, strand), &mut cyclic[HALF..HALF + places]);
                    for near in 0..HALF {
                        // The last place is beside the first.
                        cyclic[near] = cyclic[places + near];
                        cyclic[HALF + places + near] = cyclic[HALF + near];
                    }
                    let (here, later) = rows.split_at_mut(row);
                    // A few places at a time: their sums stay in registers.
                    let sums = before.as_chunks::<TOGETHER>().0.iter().zip(here.as_chunks_mut::<TOGETHER>().0);
                    for ((before, here), first) in sums.zip((0..).step_by(TOGETHER)) {
                        let near = &cyclic[first..first + TOGETHER + 2 * HALF];
                        let mut sums: [f32; TOGETHER] = from_fn(|place| near[place] + near[place + 1]);
                        for shift in 2..=2 * HALF {
                            sums.iter_mut().zip(&near[shift..]).for_each(|(sum, value)| *sum += value);
                        }
                        *here = from_fn(|place| before[place] + sums[place]);
                    }
                    here[places..].fill(0.0);
                    (before, rows) = (here, later);
                }
            },
        );
    }

    /// The blocks up to `half` of them away from one, counted from the first.
    pub fn about(&self, block: usize, half: usize) -> Range<usize> {
        block.saturating_sub(half)..(block + half + 1).min(self.blocks)
    }

    /// Sums over blocks, for every place.
    pub fn within(&self, blocks: &Range<usize>, to: &mut [f32]) {
        let sums = |block: usize| &self.values[block * self.row..(block + 1) * self.row];
        let sums = sums(blocks.end).iter().zip(sums(blocks.start));
        wide(
            #[inline(always)]
            || to.iter_mut().zip(sums).for_each(|(to, (until, before))| *to = until - before),
        );
    }
}
