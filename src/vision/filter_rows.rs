//! Rows of sums that filters along the wires are made of: across the wires first, then moved along the rope.

use super::evidence::Evidence;
use super::wide::wide;
use std::ops::Range;

/// Rows of sums of one strand, block after block.
#[derive(Debug, Default)]
pub(super) struct Rows {
    values: Vec<f32>,
}

impl Rows {
    /// Sums over `HALF` places to either side of every place of a strand.
    pub fn across<const HALF: usize>(
        &mut self,
        evidence: &Evidence,
        strand: usize,
        blocks: Range<usize>,
        value: impl Fn(f32, f32) -> f32,
    ) {
        let (places, row) = (evidence.places, evidence.row());
        self.values.resize(blocks.len() * row, 0.0);
        let mut cyclic = vec![0.0f32; row + 2 * HALF];
        wide(
            #[inline(always)]
            || {
                for (block, to) in blocks.zip(self.values.chunks_exact_mut(row)) {
                    let of_block = evidence.of(block, strand);
                    let from = evidence.sums[of_block.clone()].iter().zip(&evidence.counts[of_block]);
                    cyclic[HALF..HALF + places].iter_mut().zip(from).for_each(|(to, (&sum, &n))| *to = value(sum, n));
                    for near in 0..HALF {
                        // The last place is beside the first.
                        cyclic[near] = cyclic[places + near];
                        cyclic[HALF + places + near] = cyclic[HALF + near];
                    }
                    to.iter_mut()
                        .zip(cyclic.iter().zip(&cyclic[1..]))
                        .for_each(|(sum, (one, other))| *sum = one + other);
                    for shift in 2..=2 * HALF {
                        to.iter_mut().zip(&cyclic[shift..]).for_each(|(sum, value)| *sum += value);
                    }
                    to[places..].fill(0.0);
                }
            },
        );
    }
}

/// The rows that lie under a filter, while it moves along the rope.
pub(super) struct Window {
    half: usize,
    rows: usize,
    /// The rows under it.
    under: Range<usize>,
}

impl Window {
    /// Before the first of so many rows.
    pub fn new(half: usize, rows: usize) -> Self {
        Self { half, rows, under: 0..0 }
    }

    /// Moves on until the row `middle` is in its middle; `sums` and `pixels` are what lies under it then.
    pub fn move_to(&mut self, middle: usize, of_sums: &Rows, sums: &mut [f32], of_pixels: &Rows, pixels: &mut [f32]) {
        let row = sums.len();
        let to = middle.saturating_sub(self.half)..(middle + self.half + 1).min(self.rows);
        let (new, old) = (self.under.end..to.end, self.under.start..to.start);
        wide(
            #[inline(always)]
            || {
                for (values, to) in [(&of_sums.values, sums), (&of_pixels.values, pixels)] {
                    for row in new.clone().map(|new| &values[new * row..(new + 1) * row]) {
                        to.iter_mut().zip(row).for_each(|(sum, new)| *sum += new);
                    }
                    for row in old.clone().map(|old| &values[old * row..(old + 1) * row]) {
                        to.iter_mut().zip(row).for_each(|(sum, old)| *sum -= old);
                    }
                }
            },
        );
        self.under = to;
    }
}
