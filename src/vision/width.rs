//! Width of the outline over a stretch against the model's, block by block, and how far that can be relied on.

use super::diameter::WithSd;
use super::reference::Reference;
use super::registration::{SIDES_RAD, strand_at_side};
use super::rope::Rope;
use super::stretch::{ViewModel, ViewStretch};

/// Length of a block in rope diameters: several wires' bumps, a fraction of a strand's pitch.
const BLOCK_DIAMETERS: f64 = 0.5;
/// Every how many lines the width is asked: the contours are medians over nine.
pub(super) const STRIDE: usize = 4;
/// Fewest blocks that a diameter is made of, and the share of a stretch's blocks that must show both edges.
const FEWEST_BLOCKS: usize = 4;
const LEAST_BLOCKS: f64 = 0.5;
/// Blocks farther off than so many standard deviations count less the farther they are.
const HUBER: f64 = 1.5;
/// What a stretch leaves of what those before it said of the scatter.
const FADING: f64 = 0.97;
/// So many comparisons of the views that agree as stated are taken to have been made before the first.
const COMPARED_BEFORE: f64 = 8.0;
/// A comparison that is off by more deviations counts as this many.
const FARTHEST: f64 = 3.0;

/// How the block widths of a view scatter along the rope, as shares of the width: sums over the stretches.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WidthScatter {
    squares: f64,
    blocks: f64,
    products: f64,
    pairs: f64,
}

impl WidthScatter {
    /// Adds what is left of a stretch's blocks.
    pub fn learn(&mut self, left: &[Option<f64>]) {
        for sum in [&mut self.squares, &mut self.blocks, &mut self.products, &mut self.pairs] {
            *sum *= FADING;
        }
        for left in left.iter().flatten() {
            self.squares += left * left;
            self.blocks += 1.0;
        }
        for (a, b) in left.windows(2).filter_map(|pair| pair[0].zip(pair[1])) {
            self.products += a * b;
            self.pairs += 1.0;
        }
    }

    /// By how much the variance of a mean of `blocks` is larger than if neighbours had nothing in common (first-order autoregression).
    pub fn shared(&self, blocks: f64) -> f64 {
        if self.squares <= 0.0 || self.pairs < 1.0 {
            return 1.0;
        }
        let seen = (self.products / self.pairs) / (self.squares / self.blocks);
        // A straight line that was taken out takes (2 + 4 share) / n of the share with it.
        let share = ((seen + 2.0 / blocks) / (1.0 - 4.0 / blocks).max(0.5)).clamp(-0.5, 0.8);
        (1.0 + share) / (1.0 - share)
    }
}

/// How far views that see one rope agree about its changes, against what they state. What they have in common is the rope's.
#[derive(Debug, Clone, Default)]
pub(super) struct WidthAgreement {
    before: Option<Vec<(f64, f64)>>,
    squares: f64,
    compared: f64,
}

impl WidthAgreement {
    /// Compares how every view's share of the mean diameter has changed since the stretch before.
    pub fn learn(&mut self, views: &[Option<WithSd>]) {
        let known: Option<Vec<WithSd>> = views.iter().copied().collect();
        let n = views.len() as f64;
        let apart = known.map(|known| -> Vec<(f64, f64)> {
            let mean = known.iter().map(|d| d.value).sum::<f64>() / n;
            let of_mean = known.iter().map(|d| d.sd * d.sd).sum::<f64>() / (n * n);
            known.iter().map(|d| (d.value - mean, d.sd * d.sd * (1.0 - 2.0 / n) + of_mean)).collect()
        });
        self.squares *= FADING;
        self.compared *= FADING;
        if let (Some(before), Some(now), true) = (&self.before, &apart, n > 1.0) {
            let change = |((a, va), (b, vb)): (&(f64, f64), &(f64, f64))| (a - b).powi(2) / (va + vb);
            let squares: f64 = before.iter().zip(now).map(change).map(|square| square.min(FARTHEST.powi(2))).sum();
            // The mean is taken out: one view follows from the others.
            self.squares += squares * (n - 1.0) / n;
            self.compared += n - 1.0;
        }
        self.before = apart;
    }

    /// Factor on the stated standard deviations.
    pub fn scale(&self) -> f64 {
        ((self.squares + COMPARED_BEFORE) / (self.compared + COMPARED_BEFORE)).sqrt()
    }
}

/// Width of the outline against the model's, block by block: medians; `None` where too few lines show both edges.
pub(super) fn block_ratios(
    rope: &Rope,
    model: &ViewModel,
    view: &ViewStretch,
    reference: &Reference,
    farther: impl Fn(usize) -> f64,
) -> Vec<Option<f64>> {
    let lines = view.outline.len();
    let block = ((BLOCK_DIAMETERS * rope.diameter_mm() / reference.pitch_mm) as usize).max(2 * STRIDE);
    let mut phases = vec![0.0; rope.strands()];
    (0..lines / block)
        .map(|at| {
            let mut ratios = Vec::with_capacity(block / STRIDE);
            for line in (at * block..(at + 1) * block).step_by(STRIDE) {
                let width = f64::from(view.outline.upper_px[line]) - f64::from(view.outline.lower_px[line]);
                if !width.is_finite() {
                    continue;
                }
                reference.phases_rad(rope, line, &mut phases);
                let angle = model.camera.angle_rad;
                let [upper, lower] = [0, 1].map(|side| {
                    let j = strand_at_side(&phases, angle, SIDES_RAD[side]);
                    model.contour.edge_px(side, phases[j] - angle)
                });
                ratios.push(width / (upper - lower) * (1.0 + farther(line)));
            }
            let middle = ratios.len() / 2;
            (ratios.len() * STRIDE * 2 >= block).then(|| *ratios.select_nth_unstable_by(middle, f64::total_cmp).1)
        })
        .collect()
}

/// A straight line through the blocks: its value in the middle, with the deviation that independent blocks would give it, and what is
/// left of every block. `None` if too few blocks are known.
pub(super) fn straight(blocks: &[Option<f64>]) -> Option<(WithSd, Vec<Option<f64>>)> {
    let known = blocks.iter().flatten().count();
    if known < FEWEST_BLOCKS || (known as f64) < LEAST_BLOCKS * blocks.len() as f64 {
        return None;
    }
    let middle = (blocks.len() as f64 - 1.0) / 2.0;
    let points: Vec<(f64, f64)> =
        blocks.iter().enumerate().filter_map(|(k, b)| Some((k as f64 - middle, (*b)?))).collect();
    let mut weights = vec![1.0; known];
    let (mut value, mut slope, mut variance) = (0.0, 0.0, 0.0);
    for _ in 0..4 {
        let (mut w, mut wx, mut wy, mut wxx, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (&(x, y), &weight) in points.iter().zip(&weights) {
            w += weight;
            wx += weight * x;
            wy += weight * y;
            wxx += weight * x * x;
            wxy += weight * x * y;
        }
        let determinant = w * wxx - wx * wx;
        slope = (w * wxy - wx * wy) / determinant;
        value = (wy - slope * wx) / w;
        let left = |&(x, y): &(f64, f64)| y - value - slope * x;
        let mut sizes: Vec<f64> = points.iter().map(|point| left(point).abs()).collect();
        let at = sizes.len() / 2;
        let sd = 1.4826 * *sizes.select_nth_unstable_by(at, f64::total_cmp).1;
        let squares: f64 = points.iter().zip(&weights).map(|(point, weight)| weight * left(point).powi(2)).sum();
        variance = squares / (w - 2.0).max(1.0) * wxx / determinant;
        for (weight, point) in weights.iter_mut().zip(&points) {
            *weight = (HUBER * sd / left(point).abs().max(1e-12)).min(1.0);
        }
    }
    let left = blocks.iter().enumerate().map(|(k, b)| b.map(|b| b - value - slope * (k as f64 - middle))).collect();
    Some((WithSd { value, sd: variance.sqrt() }, left))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise between -1 and 1, without chance.
    fn noise(k: usize) -> f64 {
        2.0 * ((k as f64 * 12.9898).sin() * 43758.5453).rem_euclid(1.0) - 1.0
    }

    #[test]
    fn a_line_through_the_blocks_passes_over_what_stands_out_and_over_gaps() {
        let mut blocks: Vec<Option<f64>> = (0..13).map(|k| Some(1.0 + 0.002 * (k as f64 - 6.0))).collect();
        blocks[3] = Some(1.08);
        blocks[9] = None;
        let (middle, left) = straight(&blocks).unwrap();
        assert!((middle.value - 1.0).abs() < 1e-3, "{middle:?}");
        assert!(left[3].unwrap() > 0.07 && left[9].is_none());
        blocks[..7].fill(None);
        assert!(straight(&blocks).is_none(), "less than half of the stretch shows both edges");
    }

    #[test]
    fn neighbours_that_go_together_make_a_mean_less_certain_and_opposite_ones_more() {
        let scatter = |of: &dyn Fn(usize) -> f64| {
            let mut scatter = WidthScatter::default();
            (0..40).for_each(|k| scatter.learn(&(0..12).map(|b| Some(of(12 * k + b))).collect::<Vec<_>>()));
            scatter.shared(12.0)
        };
        assert!(scatter(&|k| noise(k / 3)) > 3.0);
        assert!(scatter(&|k| noise(k / 2) * if k % 2 == 0 { 1.0 } else { -1.0 }) < 1.0);
        assert_eq!(WidthScatter::default().shared(12.0), 1.0);
    }

    #[test]
    fn deviations_become_those_by_which_the_views_differ_but_not_those_of_the_rope() {
        for (differ, expected) in [(1.73, 1.0), (2.6, 1.5)] {
            let mut agreement = WidthAgreement::default();
            for k in 0..150 {
                let rope = 32.0 - 0.01 * k as f64;
                let view = |v: usize| Some(WithSd { value: rope + 0.01 * differ * noise(5 * k + v), sd: 0.01 });
                agreement.learn(&(0..4).map(view).collect::<Vec<_>>());
            }
            // Uniform noise of +-1.73 has sd 1. What was taken to have been seen before still weighs, and far ones are cut.
            assert!((agreement.scale() - expected).abs() < 0.25, "{} for {expected}", agreement.scale());
        }
        let mut alone = WidthAgreement::default();
        (0..9).for_each(|k| alone.learn(&[Some(WithSd { value: 32.0 + noise(k), sd: 0.01 })]));
        assert_eq!(alone.scale(), 1.0, "a single view leaves what is stated");
    }
}
