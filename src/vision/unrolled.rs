//! The gray of the unrolled rope as a picture: what was seen and what was expected, finer across the wires than evidence is.
//!
//! Evidence judges single places. What lies about a place tells damage from foreign matter, and for that its shape must be seen.

use super::surface_map::PLACES_PER_WIRE;

/// Fine places across every wire: two in each place of the evidence.
pub const FINE_PER_WIRE: usize = 2 * PLACES_PER_WIRE;
/// Steps that a gray bin of deviation is told in.
const DEVIATION_STEPS: f32 = 6.0;
/// Steps that a gray bin of expectation is told in.
const EXPECTED_STEPS: f32 = 7.9;
/// Expectation of a place that no pixel fell into.
const UNSEEN: u8 = u8::MAX;

/// Deviation and expectation of a stretch in one view, `[(strand * blocks + block) * places + place]`, in the steps in which they are
/// kept: a picture needs no more, and intact rope waits in memory until a calibration judges it.
#[derive(Debug, Clone)]
pub struct Unrolled {
    pub(super) blocks: usize,
    pub(super) places: usize,
    pub(super) deviation: Vec<i8>,
    pub(super) expected: Vec<u8>,
}

/// Gray of a fine place, in gray bins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gray {
    /// How far it is from what is expected.
    pub deviation: f32,
    /// What is expected.
    pub expected: f32,
}

/// Sums over the pixels of a fine place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GraySums {
    /// Deviations from the expected gray.
    pub deviation: f32,
    /// Expected gray.
    pub expected: f32,
    /// Pixels.
    pub pixels: f32,
}

impl Unrolled {
    /// Bytes that a place of the evidence takes.
    pub const BYTES_PER_PLACE: usize = 4;

    /// Nothing seen yet, of strands of so many wires.
    pub(super) fn unseen(blocks: usize, strands: usize, wires: usize) -> Self {
        let places = wires * FINE_PER_WIRE;
        let len = blocks * strands * places;
        Self { blocks, places, deviation: vec![0; len], expected: vec![UNSEEN; len] }
    }

    /// Takes what was seen of a strand in a block, and leaves the sums empty.
    pub(super) fn take(&mut self, block: usize, strand: usize, sums: &mut [GraySums]) {
        let first = (strand * self.blocks + block) * self.places;
        for (at, sums) in (first..).zip(sums).filter(|(_, sums)| sums.pixels > 0.0) {
            let sums = std::mem::take(sums);
            let deviation = sums.deviation / sums.pixels * DEVIATION_STEPS;
            self.deviation[at] = (deviation + 0.5f32.copysign(deviation)) as i8; // to the nearest, and saturates
            let expected = sums.expected / sums.pixels * EXPECTED_STEPS + 0.5;
            self.expected[at] = expected.clamp(0.0, f32::from(UNSEEN - 1)) as u8;
        }
    }

    /// Blocks of the stretch.
    pub fn blocks(&self) -> usize {
        self.blocks
    }

    /// Wires of a strand.
    pub fn wires(&self) -> usize {
        self.places / FINE_PER_WIRE
    }

    /// The gray of a fine place, `place` counted from the first of wire 0; `None` where no pixel fell.
    #[inline]
    pub fn gray(&self, block: usize, strand: usize, place: usize) -> Option<Gray> {
        let at = (strand * self.blocks + block) * self.places + place;
        (self.expected[at] != UNSEEN).then(|| Gray {
            deviation: f32::from(self.deviation[at]) / DEVIATION_STEPS,
            expected: f32::from(self.expected[at]) / EXPECTED_STEPS,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_seen_is_told_to_a_fraction_of_a_bin_and_the_rest_is_unseen() {
        let mut unrolled = Unrolled::unseen(4, 2, 7);
        let mut sums = vec![GraySums::default(); 7 * FINE_PER_WIRE];
        sums[13] = GraySums { deviation: -10.0, expected: 64.0, pixels: 4.0 };
        sums[14] = GraySums { deviation: 400.0, expected: 140.0, pixels: 4.0 };
        unrolled.take(2, 1, &mut sums);
        let gray = unrolled.gray(2, 1, 13).unwrap();
        assert!((gray.deviation + 2.5).abs() < 0.1 && (gray.expected - 16.0).abs() < 0.1, "{gray:?}");
        let far = unrolled.gray(2, 1, 14).unwrap();
        assert!(far.deviation > 20.0 && far.expected > 31.0, "cut, but far: {far:?}");
        assert_eq!((unrolled.gray(2, 0, 13), unrolled.gray(1, 1, 13), unrolled.gray(2, 1, 12)), (None, None, None));
    }
}
