//! A patch of the unrolled rope about a place: three wires wide and 14 mm long, as layers that a network can look at.

use super::evidence::{Evidence, GRAY};
use super::factor::FACTORS;
use super::surface_map::PLACES_PER_WIRE;
use super::unrolled::{Gray, Unrolled};

/// Blocks along the rope.
pub const BLOCKS: usize = 28;
/// Wires across: the wire of the place and those on either side.
const WIRES: usize = 3;
/// Places across.
pub const PLACES: usize = WIRES * PLACES_PER_WIRE;
/// Values of every place: deviation and expectation of its two fine places, whether the first was seen, and how unusual every further
/// factor is.
pub const LAYERS: usize = 5 + FACTORS.len();
/// Gray bins of deviation that count 1.
const DEVIATION_BINS: f32 = 4.0;
/// Gray bins of expectation that count 1.
const EXPECTED_BINS: f32 = 16.0;
/// Standard deviations of a further factor that count 1.
const FACTOR_SDS: f32 = 2.0;

/// Values of a patch, `[(block * PLACES + place) * LAYERS + layer]`; 0 beyond the ends of the stretch and where nothing was seen.
#[derive(Debug, Clone)]
pub struct Patch {
    values: Vec<f32>,
}

impl Default for Patch {
    fn default() -> Self {
        Self { values: vec![0.0; BLOCKS * PLACES * LAYERS] }
    }
}

impl Patch {
    /// Cuts the patch about a wire of a strand in a block out of what was seen, and of what further factors say of it.
    pub fn cut(&mut self, unrolled: &Unrolled, evidence: &Evidence, block: usize, strand: usize, wire: usize) {
        self.values.fill(0.0);
        let wires = unrolled.wires();
        let first_wire = wire + wires - WIRES / 2;
        for (row, values) in self.values.chunks_exact_mut(PLACES * LAYERS).enumerate() {
            let Some(block) = (block + row).checked_sub(BLOCKS / 2).filter(|&block| block < unrolled.blocks()) else {
                continue;
            };
            for (across, values) in values.chunks_exact_mut(LAYERS).enumerate() {
                let place =
                    (first_wire + across / PLACES_PER_WIRE) % wires * PLACES_PER_WIRE + across % PLACES_PER_WIRE;
                let [near, far] = [0, 1].map(|half| unrolled.gray(block, strand, 2 * place + half));
                for (half, gray) in [near, far].into_iter().enumerate() {
                    if let Some(Gray { deviation, expected }) = gray {
                        values[half] = deviation / DEVIATION_BINS;
                        values[2 + half] = expected / EXPECTED_BINS;
                    }
                }
                values[4] = if near.is_some() { 1.0 } else { 0.0 };
                let at = evidence.of(block, strand).start + place;
                for (value, factor) in values[5..].iter_mut().zip(&evidence.factors[GRAY + 1..]) {
                    *value = factor.sums[at] / FACTOR_SDS;
                }
            }
        }
    }

    #[cfg(test)]
    pub(super) fn of(values: Vec<f32>) -> Self {
        Self { values }
    }

    /// The values.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::unrolled::{FINE_PER_WIRE, GraySums};

    #[test]
    fn a_patch_shows_its_wire_in_the_middle_and_goes_round_the_strand() {
        const WIRES_OF_STRAND: usize = 7;
        let mut unrolled = Unrolled::unseen(40, 2, WIRES_OF_STRAND);
        let mut sums = vec![GraySums::default(); WIRES_OF_STRAND * FINE_PER_WIRE];
        // Wire 6 is beside wire 0.
        sums[6 * FINE_PER_WIRE + 3] = GraySums { deviation: 4.0, expected: 16.0, pixels: 1.0 };
        sums[2] = GraySums { deviation: -8.0, expected: 8.0, pixels: 1.0 };
        unrolled.take(5, 1, &mut sums);
        let mut evidence = Evidence::empty(5, 40, 2, WIRES_OF_STRAND * PLACES_PER_WIRE);
        let mut further = evidence.factors[GRAY].clone();
        further.sums[evidence.of(5, 1).start + 1] = 3.0;
        evidence.factors.push(further);
        let mut patch = Patch::default();
        patch.cut(&unrolled, &evidence, 5, 1, 0);
        let at = |block: usize, place: usize, layer: usize| patch.values()[(block * PLACES + place) * LAYERS + layer];
        let row = BLOCKS / 2;
        assert!((at(row, 1, 1) - 1.0).abs() < 0.05 && (at(row, 1, 3) - 1.0).abs() < 0.05, "the wire before");
        assert!((at(row, 6, 0) + 2.0).abs() < 0.05 && (at(row, 6, 2) - 0.5).abs() < 0.05, "the wire itself");
        assert_eq!((at(row, 6, 4), at(row, 1, 4), at(row, 7, 4)), (1.0, 0.0, 0.0), "whether the first half was seen");
        assert_eq!(at(row, 6, 5), 1.5);
        assert!(patch.values().iter().filter(|value| **value != 0.0).count() == 6, "nothing else was seen");
    }
}
