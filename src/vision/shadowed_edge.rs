//! Where the rope begins inside the outline of a shadow.
//!
//! Seen from its own outline a shadow looks the same everywhere, but for noise; rope does not. What is compared is the slope of
//! the gray values across the strip: shadows may be deeper here and there. The boundary that has as little as possible to see outside and
//! as much as possible inside is found for all blocks together, as a course that does not jump (dynamic programming): where
//! the rope is as dark as the shadow beside it, its neighbours along the rope decide.

use super::edge_strip::{EdgeStrip, OUTSIDE};
use super::shadow::{LEAST_NOISE, reach_px};

/// Pixels on either side whose difference is the slope: two, as wide as the blur of the lens.
const SLOPE_PX: usize = 2;
/// Squared deviation from the usual slope, in units of the noise, that is as likely in rope as in a shadow, where it is 1 on
/// average. A choice: 2 to 4 do nearly as well.
const NEITHER: f32 = 2.5;
/// More than so many times that says no more: a speck of dirt on the background is no rope.
const MOST: f32 = 3.0;
/// Price of a step of the boundary by one pixel from block to block. A choice: 2 to 10 do nearly as well.
const STEP_PRICE: f32 = 5.0;
/// Most pixels that the boundary may move from block to block.
const MOST_STEPS: usize = 3;
/// Blocks on either side over which the boundary, found in whole pixels, is averaged.
const AVERAGED: usize = 2;

/// How far inside its edge the rope begins, in px at every line; `None` if there is no rope in the strip.
pub(super) fn rope_inside(strip: &EdgeStrip) -> Option<Vec<f32>> {
    let evidence = evidence(strip);
    let depth = strip.width - OUTSIDE;
    let course = best_course(&evidence, depth);
    let of_rope: f32 =
        course.iter().zip(evidence.chunks_exact(depth)).map(|(&k, row)| row[k..].iter().sum::<f32>()).sum();
    if of_rope <= 0.0 {
        return None;
    }
    let averaged: Vec<f32> = (0..course.len())
        .map(|block| {
            let near = &course[block.saturating_sub(AVERAGED)..(block + AVERAGED + 1).min(course.len())];
            // A slope tells of rope as soon as its inner pixels lie on it: half a pixel to two before its middle does.
            near.iter().sum::<usize>() as f32 / near.len() as f32 + 0.5 * SLOPE_PX as f32
        })
        .collect();
    let middle = 0.5 * (strip.block_lines as f32 - 1.0);
    Some((0..strip.lines).map(|line| at(&averaged, (line as f32 - middle) / strip.block_lines as f32)).collect())
}

/// Value at a place between the values, the first or last one beyond the ends.
fn at(values: &[f32], place: f32) -> f32 {
    let place = place.clamp(0.0, (values.len() - 1) as f32);
    let (k, share) = (place as usize, place.fract());
    values[k] + share * (values[(k + 1).min(values.len() - 1)] - values[k])
}

/// What speaks for rope (positive) or shadow in every block, by distance from the edge inwards.
fn evidence(strip: &EdgeStrip) -> Vec<f32> {
    let depth = strip.width - OUTSIDE;
    // slope between the pixels before and from `k` on
    let mut slopes = Vec::with_capacity(strip.gray.len() / strip.width * depth);
    for row in strip.gray.chunks_exact(strip.width) {
        let mean = |k: usize| row[k..k + SLOPE_PX].iter().sum::<f32>() / SLOPE_PX as f32;
        slopes.extend((OUTSIDE..strip.width).map(|k| mean(k.min(strip.width - SLOPE_PX)) - mean(k - SLOPE_PX)));
    }
    let (usual, spread) = EdgeStrip::medians(&slopes, depth);
    // Shadows vary most where they are steep, at their outline: what they vary by there is not what they vary by further in.
    let reach = reach_px(strip);
    let of_mean = (2.0 / (SLOPE_PX * strip.block_lines) as f32).sqrt();
    let mut varies = f32::INFINITY;
    let mut weight = vec![0.0; depth];
    for k in reach..depth {
        let noise = strip.noise[OUTSIDE + k].max(LEAST_NOISE) * of_mean;
        let mut near: [f32; 3] = std::array::from_fn(|m| spread[(k + m).saturating_sub(1).min(depth - 1)] / noise);
        near.sort_unstable_by(f32::total_cmp);
        varies = varies.min(near[1]).max(1.0);
        weight[k] = 1.0 / (noise * varies);
    }
    for row in slopes.chunks_exact_mut(depth) {
        for (k, value) in row.iter_mut().enumerate() {
            let deviation = (*value - usual[k]) * weight[k];
            // blocks without an edge say nothing
            *value = if deviation.is_nan() { 0.0 } else { (deviation * deviation).min(MOST * NEITHER) - NEITHER };
        }
    }
    slopes
}

/// The boundary, block by block, that has the most evidence inside it for the least steps.
fn best_course(evidence: &[f32], depth: usize) -> Vec<usize> {
    // best sum of a course up to a block, by where it ends; what lies beyond the strip is never best
    let mut before = vec![f32::NEG_INFINITY; depth + 2 * MOST_STEPS];
    before[MOST_STEPS..depth + MOST_STEPS].fill(0.0);
    let mut best = vec![0.0f32; depth];
    let mut came_from = vec![0u8; evidence.len()];
    for (row, came_from) in evidence.chunks_exact(depth).zip(came_from.chunks_exact_mut(depth)) {
        best.copy_from_slice(&before[MOST_STEPS..depth + MOST_STEPS]);
        came_from.fill(MOST_STEPS as u8);
        for steps in (0..=2 * MOST_STEPS).filter(|&steps| steps != MOST_STEPS) {
            let price = STEP_PRICE * steps.abs_diff(MOST_STEPS) as f32;
            for ((best, came_from), from) in best.iter_mut().zip(came_from.iter_mut()).zip(&before[steps..]) {
                let better = from - price > *best;
                *best = if better { from - price } else { *best };
                *came_from = if better { steps as u8 } else { *came_from };
            }
        }
        let mut inside = 0.0;
        for k in (0..depth).rev() {
            inside += row[k];
            before[MOST_STEPS + k] = best[k] + inside;
        }
    }
    let ends = &before[MOST_STEPS..depth + MOST_STEPS];
    let mut k = (0..depth).fold(0, |most, k| if ends[k] > ends[most] { k } else { most });
    let back = came_from.chunks_exact(depth).rev();
    let mut course: Vec<usize> = back
        .map(|steps| {
            let here = k;
            k = k + usize::from(steps[k]) - MOST_STEPS;
            here
        })
        .collect();
    course.reverse();
    course
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shadow of 200 blocks, as flat as a profile may be, with rope behind a boundary.
    fn strip(boundary: impl Fn(usize) -> f32, wires: f32) -> EdgeStrip {
        let width = OUTSIDE + 60;
        let gray = (0..200 * width)
            .map(|p| {
                let (block, inside) = (p / width, (p % width) as f32 - OUTSIDE as f32);
                let shadow = 180.0 - 110.0 * (inside / 20.0).clamp(0.0, 1.0).sqrt();
                let rope = (inside - boundary(block)).clamp(0.0, 1.0);
                let noise = 0.7 * ((block * 7 + p * 13) % 5) as f32 - 1.4;
                shadow + rope * wires * (0.5 * inside + 0.9 * block as f32).sin() + 0.5 * noise
            })
            .collect();
        EdgeStrip { block_lines: 8, lines: 1605, width, gray, noise: vec![2.0; width] }
    }

    #[test]
    fn rope_begins_where_wires_begin_to_pass() {
        let boundary = |block: usize| 30.0 + 6.0 * (block as f32 / 9.0).sin();
        let depth_px = rope_inside(&strip(boundary, 25.0)).unwrap();
        assert_eq!(depth_px.len(), 1605, "lines beyond the last whole block have a value, too");
        for (line, depth_px) in depth_px.iter().enumerate().take(1600) {
            let truth = boundary(line / 8);
            assert!((depth_px - truth).abs() < 3.0, "line {line}: {depth_px} of {truth}");
        }
    }

    #[test]
    fn where_nothing_passes_there_is_no_rope() {
        assert!(rope_inside(&strip(|_| 30.0, 0.0)).is_none());
    }

    #[test]
    fn a_course_crosses_what_says_nothing_and_pays_for_steps() {
        let depth = 20;
        let row = |boundary: usize| (0..depth).map(move |k| if k < boundary { -2.0 } else { 2.0 });
        let evidence: Vec<f32> = (0..4)
            .flat_map(|_| row(5))
            .chain(std::iter::repeat_n(0.0, 2 * depth))
            .chain((0..4).flat_map(|_| row(11)))
            .collect();
        let course = best_course(&evidence, depth);
        assert_eq!((course[0], course[3], course[6], course[9]), (5, 5, 11, 11));
        let steps = course.windows(2).map(|pair| pair[1].abs_diff(pair[0]));
        assert!(steps.max() <= Some(MOST_STEPS), "{course:?}");
    }
}
