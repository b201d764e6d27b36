//! Filters along the course of the wires: sums over places and blocks about every place. [Wacker13, sec. 5: mean filter along the wire]
//!
//! More than half of the strands are on the other side of the rope. So it is done strand by strand, for the blocks in which the strand
//! passes through the view, and what is summed stays in the processor's cache.

use super::evidence::{Evidence, FILTERS, FactorSums, GRAY, UNSEEN};
use super::filter_rows::Rows;
use super::surface_map::PLACES_PER_WIRE;
use std::ops::Range;

/// Places to either side that are summed across: filters are one wire wide.
const HALF_PLACES: usize = (PLACES_PER_WIRE - 1) / 2;
/// Rows of sums are filled up with zeros to a multiple of this, so that loops over them need no remainder.
pub(super) const TOGETHER: usize = 16;
/// Thinned out, filters are asked at steps of this share of their length: sums over nearly the same rope say the same.
const STEP_SHARE: f64 = 0.25;

/// How many blocks filters are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Steps {
    /// Every one.
    Every,
    /// One of those that lie within `STEP_SHARE` of a filter's length.
    Thinned,
}

/// What falls under a filter about every place of one strand in one block.
#[derive(Debug, Clone)]
pub struct Filtered<'a> {
    /// Number of the filter in [`FILTERS`].
    pub filter: usize,
    /// The strand.
    pub strand: usize,
    /// The block.
    pub block: usize,
    /// The blocks that it stands for, itself among them.
    pub stands_for: Range<usize>,
    /// Numbers of the factors that were asked.
    pub factors: &'a [usize],
    /// Sums of scores, one row a factor; beyond the last place there are zeros up to a multiple of `TOGETHER`.
    sums: &'a [f32],
    /// Numbers of pixels; as many as a row has.
    pub pixels: &'a [f32],
    /// Region of the surface that the place itself shows, or [`UNSEEN`].
    pub regions: &'a [u8],
}

impl Filtered<'_> {
    /// Every factor that was asked, by its number, and the sums of its scores.
    #[inline(always)]
    pub fn sums(&self) -> impl Iterator<Item = (usize, &[f32])> {
        self.factors.iter().copied().zip(self.sums.chunks_exact(self.pixels.len()))
    }
}

impl Evidence {
    /// Places of a strand and the zeros after them.
    pub(super) fn row(&self) -> usize {
        self.places.next_multiple_of(TOGETHER)
    }

    /// Places of a strand in a block.
    pub(super) fn of(&self, block: usize, strand: usize) -> Range<usize> {
        let first = (strand * self.blocks + block) * self.places;
        first..first + self.places
    }

    /// The same in tables that run block by block, as scores do.
    pub(super) fn of_scores(&self, block: usize, strand: usize) -> Range<usize> {
        let first = (block * self.strands + strand) * self.places;
        first..first + self.places
    }

    /// Calls `each` with what falls under every filter, of the factors that are `asked` by their numbers.
    pub fn filtered(
        &self,
        pitch_mm: f64,
        steps: Steps,
        asked: impl Fn(usize) -> bool,
        mut each: impl FnMut(Filtered<'_>),
    ) {
        if asked(GRAY) {
            let counts = |at: Range<usize>, to: &mut [f32]| to.copy_from_slice(&self.counts[at]);
            self.filtered_together(&[GRAY], counts, pitch_mm, steps, &mut each);
        }
        let further: Vec<usize> = (GRAY + 1..self.factors.len()).filter(|&factor| asked(factor)).collect();
        if !further.is_empty() {
            let once = |at: Range<usize>, to: &mut [f32]| {
                let places = to.iter_mut().zip(&self.regions[at]);
                places.for_each(|(to, &region)| *to = if region == UNSEEN { 0.0 } else { 1.0 });
            };
            self.filtered_together(&further, once, pitch_mm, steps, &mut each);
        }
    }

    /// The same for factors that share their numbers of pixels, which `count` writes.
    fn filtered_together(
        &self,
        factors: &[usize],
        count: impl Fn(Range<usize>, &mut [f32]),
        pitch_mm: f64,
        steps: Steps,
        each: &mut impl FnMut(Filtered<'_>),
    ) {
        let block_mm = self.block_lines as f64 * pitch_mm;
        let farthest = FILTERS.map(|filter| half_blocks(filter.length_mm, block_mm)).into_iter().max().unwrap_or(0);
        let (mut pixels, mut sums) = (Rows::default(), vec![Rows::default(); factors.len()]);
        let row = self.row();
        let (mut under_sums, mut under_pixels) = (vec![0.0f32; factors.len() * row], vec![0.0f32; row]);
        for (strand, blocks) in self.passes(2 * farthest + 1) {
            pixels.across::<HALF_PLACES>(self, strand, blocks.clone(), &count);
            let mut cut_at: Option<f32> = None;
            for (number, filter) in FILTERS.into_iter().enumerate() {
                // Filters of one cut stand side by side and share what they sum across the wires.
                if cut_at != Some(filter.cut) {
                    for (rows, &factor) in sums.iter_mut().zip(factors) {
                        self.sum_across(rows, (strand, &blocks), factor, filter.cut);
                    }
                }
                cut_at = Some(filter.cut);
                let half = half_blocks(filter.length_mm, block_mm);
                let step = match steps {
                    Steps::Every => 1,
                    Steps::Thinned => ((STEP_SHARE * filter.length_mm / block_mm) as usize).max(1),
                };
                for first in blocks.clone().step_by(step) {
                    let stands_for = first..(first + step).min(blocks.end);
                    let block = (stands_for.start + stands_for.end) / 2;
                    let about = pixels.about(block - blocks.start, half);
                    pixels.within(&about, &mut under_pixels);
                    for (rows, under) in sums.iter().zip(under_sums.chunks_exact_mut(row)) {
                        rows.within(&about, under);
                    }
                    each(Filtered {
                        filter: number,
                        strand,
                        block,
                        stands_for,
                        factors,
                        sums: &under_sums,
                        pixels: &under_pixels,
                        regions: &self.regions[self.of(block, strand)],
                    });
                }
            }
        }
    }

    /// Sums the scores of a factor across the wires; a place says no more than `cut` a pixel.
    fn sum_across(&self, rows: &mut Rows, (strand, blocks): (usize, &Range<usize>), factor: usize, cut: f32) {
        let FactorSums { both_ways, sums } = &self.factors[factor];
        let lowest = if *both_ways { -cut } else { f32::NEG_INFINITY };
        let within = |sum: f32, least: f32, most: f32| {
            let sum = if sum < most { sum } else { most };
            if sum > least { sum } else { least }
        };
        if factor == GRAY {
            rows.across::<HALF_PLACES>(self, strand, blocks.clone(), |at, to| {
                let places = to.iter_mut().zip(&sums[at.clone()]).zip(&self.counts[at]);
                places.for_each(|((to, &sum), &n)| {
                    *to = within(sum, if *both_ways { lowest * n } else { lowest }, cut * n)
                });
            });
        } else {
            rows.across::<HALF_PLACES>(self, strand, blocks.clone(), |at, to| {
                to.iter_mut().zip(&sums[at]).for_each(|(to, &sum)| *to = within(sum, lowest, cut));
            });
        }
    }

    /// Passes of the strands through the view: a strand, and blocks from the first to the last that shows it. Passes less than `apart`
    /// blocks from each other are one.
    pub(super) fn passes(&self, apart: usize) -> Vec<(usize, Range<usize>)> {
        let mut passes: Vec<(usize, Range<usize>)> = Vec::new();
        for strand in 0..self.strands {
            for block in 0..self.blocks {
                // All of them at once: looking until one is seen takes longer.
                let regions = &self.regions[self.of(block, strand)];
                if regions.iter().fold(true, |unseen, &region| unseen & (region == UNSEEN)) {
                    continue;
                }
                match passes.last_mut() {
                    Some((of, blocks)) if *of == strand && block < blocks.end + apart => blocks.end = block + 1,
                    _ => passes.push((strand, block..block + 1)),
                }
            }
        }
        passes
    }
}

/// Blocks to either side that make a length.
pub(super) fn half_blocks(length_mm: f64, block_mm: f64) -> usize {
    ((length_mm / block_mm - 1.0) / 2.0).round().max(0.0) as usize
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::vision::evidence::block_lines;

    pub const PITCH_MM: f64 = 0.1;
    pub const BLOCKS: usize = 400;
    const PLACES: usize = 35;

    /// Two strands: the first is seen twice, the second never.
    pub fn evidence() -> Evidence {
        let mut evidence = Evidence::empty(block_lines(PITCH_MM), BLOCKS, 2, PLACES);
        for block in (20..90).chain(150..380) {
            for place in (0..12).chain(25..PLACES) {
                let score = ((block * 31 + place * 17) % 23) as f32 / 4.0 - 2.0;
                evidence.set(evidence.of(block, 0).start + place, score, 1.0, (place / 10) as u8);
            }
        }
        evidence
    }

    /// Sums of the one factor that there is.
    fn gray<'a>(filtered: &'a Filtered<'_>) -> &'a [f32] {
        let [(GRAY, sums)] = filtered.sums().collect::<Vec<_>>()[..] else { panic!("{:?}", filtered.factors) };
        sums
    }

    #[test]
    fn a_filter_sums_what_lies_within_its_length_and_a_wires_width() {
        let evidence = evidence();
        let mut asked = vec![vec![0; BLOCKS]; FILTERS.len()];
        evidence.filtered(
            PITCH_MM,
            Steps::Every,
            |_| true,
            |filtered| {
                assert_eq!((filtered.strand, &filtered.stands_for), (0, &(filtered.block..filtered.block + 1)));
                asked[filtered.filter][filtered.block] += 1;
                let half = half_blocks(FILTERS[filtered.filter].length_mm, 0.5);
                let rows = filtered.block.saturating_sub(half)..(filtered.block + half + 1).min(BLOCKS);
                for place in 0..PLACES {
                    let (mut sum, mut n) = (0.0, 0.0);
                    for block in rows.clone() {
                        for across in place + PLACES - 2..=place + PLACES + 2 {
                            let at = evidence.of(block, 0).start + across % PLACES;
                            sum +=
                                evidence.factors[GRAY].sums[at].min(FILTERS[filtered.filter].cut * evidence.counts[at]);
                            n += evidence.counts[at];
                        }
                    }
                    assert!(
                        (gray(&filtered)[place] - sum).abs() < 2e-2 && filtered.pixels[place] == n,
                        "{place} of {filtered:?}"
                    );
                }
                assert!(gray(&filtered)[PLACES..].iter().chain(&filtered.pixels[PLACES..]).all(|zero| *zero == 0.0));
            },
        );
        // Everywhere where the strand is seen, and once.
        assert!(asked.iter().all(|blocks| (20..90).chain(150..380).all(|block| blocks[block] == 1)));
        assert!(asked.iter().all(|blocks| blocks[..20].iter().chain(&blocks[380..]).all(|times| *times == 0)));
    }

    #[test]
    fn every_place_that_is_seen_counts_once_for_further_factors_and_says_no_more_than_the_cut() {
        let mut evidence = evidence();
        let sums = vec![-3.0; evidence.regions.len()];
        for both_ways in [false, true] {
            evidence.factors.push(FactorSums { both_ways, sums: sums.clone() });
        }
        let longest = FILTERS.len() - 1;
        let mut met = 0;
        evidence.filtered(
            PITCH_MM,
            Steps::Every,
            |factor| factor != GRAY,
            |filtered| {
                if filtered.filter == longest && filtered.block == 250 {
                    let n = 5.0 * (2 * half_blocks(FILTERS[longest].length_mm, 0.5) + 1) as f32;
                    let of_place: Vec<(usize, f32)> = filtered.sums().map(|(factor, sums)| (factor, sums[5])).collect();
                    assert_eq!(filtered.pixels[5], n);
                    assert_eq!(of_place, [(1, -3.0 * n), (2, -FILTERS[longest].cut * n)]);
                    met += 1;
                }
            },
        );
        assert_eq!(met, 1, "both together");
    }

    #[test]
    fn thinned_out_filters_say_the_same_for_all_blocks_that_they_stand_for() {
        let evidence = evidence();
        let mut every = vec![vec![Vec::new(); BLOCKS]; FILTERS.len()];
        evidence.filtered(PITCH_MM, Steps::Every, |_| true, |f| every[f.filter][f.block] = gray(&f).to_vec());
        let mut stood_for = vec![[0; FILTERS.len()]; BLOCKS];
        evidence.filtered(
            PITCH_MM,
            Steps::Thinned,
            |_| true,
            |f| {
                assert!(
                    f.stands_for.contains(&f.block)
                        && f.stands_for.len() as f64 * 0.5 <= (STEP_SHARE * FILTERS[f.filter].length_mm).max(0.5)
                );
                let exact = &every[f.filter][f.block];
                assert_eq!(gray(&f), exact);
                f.stands_for.for_each(|block| stood_for[block][f.filter] += 1);
            },
        );
        assert!((20..90).chain(150..380).all(|block| stood_for[block] == [1; FILTERS.len()]));
    }
}
