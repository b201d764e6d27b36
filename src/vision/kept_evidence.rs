//! Evidence that waits in memory until a calibration judges it, in half the precision: the more intact rope is held back, the surer
//! is the threshold that follows from it.

use super::camera::Camera;
use super::estimates::Estimates;
use super::evidence::{Evidence, FactorSums};
use super::inspection_model::{AlignedView, Seen};
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::unrolled::Unrolled;
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Evidence of a stretch with sums to 11 bits: a 2000th of a sum is far below its noise. Numbers of pixels stay exact up to 2048.
#[derive(Debug, Clone)]
struct KeptEvidence {
    /// All but sums and counts.
    rest: Evidence,
    /// Of every factor.
    sums: Vec<Vec<f16>>,
    counts: Vec<f16>,
}

impl KeptEvidence {
    /// Evidence in full precision again.
    fn unpacked(&self) -> Evidence {
        let wide = |values: &[f16]| {
            let mut wide = vec![0.0; values.len()];
            values.convert_to_f32_slice(&mut wide);
            wide
        };
        let of_factor = |(factor, sums): (&FactorSums, &Vec<f16>)| FactorSums { sums: wide(sums), ..*factor };
        let factors = self.rest.factors.iter().zip(&self.sums).map(of_factor).collect();
        Evidence { factors, counts: wide(&self.counts), ..self.rest.clone() }
    }
}

impl From<Evidence> for KeptEvidence {
    fn from(mut evidence: Evidence) -> Self {
        let narrow = |values: &mut Vec<f32>| {
            let values = std::mem::take(values);
            let mut narrow = vec![f16::ZERO; values.len()];
            narrow.convert_from_f32_slice(&values);
            narrow
        };
        let sums = evidence.factors.iter_mut().map(|factor| narrow(&mut factor.sums)).collect();
        let counts = narrow(&mut evidence.counts);
        Self { rest: evidence, sums, counts }
    }
}

/// All that was seen of a stretch in one view.
#[derive(Debug, Clone)]
pub struct KeptSeen {
    evidence: KeptEvidence,
    unrolled: Unrolled,
    margin_blocks: usize,
    image: KeptImage,
}

/// The image of a stretch in one view, and where the rope is in it.
#[derive(Debug, Clone)]
pub struct KeptImage {
    camera: Camera,
    estimates: Estimates,
    view: ViewStretch,
    block_lines: usize,
    pitch_mm: f64,
}

impl KeptImage {
    /// Of an aligned view only what is looked at again.
    pub fn of(&AlignedView { camera, estimates, view, block_lines, pitch_mm, .. }: &AlignedView<'_>) -> Self {
        let (image, lost, axis_px) = (view.image.clone(), view.lost.clone(), view.axis_px.clone());
        let view = ViewStretch { image, lost, axis_px, ..ViewStretch::default() };
        Self { camera: *camera, estimates: estimates.clone(), view, block_lines, pitch_mm }
    }
}

impl KeptSeen {
    /// Bytes that a place of the unrolled rope takes with so many factors: sums of all, one count and one region.
    pub const fn bytes_per_place(factors: usize) -> usize {
        2 * factors + 3 + Unrolled::BYTES_PER_PLACE
    }

    /// What was seen in an image.
    pub fn new(seen: Seen, image: KeptImage) -> Self {
        Self { evidence: seen.evidence.into(), unrolled: seen.unrolled, margin_blocks: seen.margin_blocks, image }
    }

    /// The image.
    pub fn image<'a>(&'a self, rope: &'a Rope) -> AlignedView<'a> {
        let KeptImage { camera, estimates, view, block_lines, pitch_mm } = &self.image;
        AlignedView { rope, camera, estimates, view, block_lines: *block_lines, pitch_mm: *pitch_mm }
    }

    /// In full precision again.
    pub fn unpacked(&self) -> Seen {
        Seen { evidence: self.evidence.unpacked(), unrolled: self.unrolled.clone(), margin_blocks: self.margin_blocks }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_is_what_it_was_to_a_thousandth() {
        let mut evidence = Evidence::empty(5, 40, 2, 35);
        evidence.factors.push(FactorSums { both_ways: true, sums: vec![-2.5; 40 * 2 * 35] });
        for at in 0..40 * 2 * 35 {
            evidence.set(at, (at as f32 * 0.37).sin() * 600.0, (at % 300) as f32, (at % 9) as u8);
        }
        let unpacked = KeptEvidence::from(evidence.clone()).unpacked();
        for (factor, unpacked) in evidence.factors.iter().zip(&unpacked.factors) {
            assert_eq!(factor.both_ways, unpacked.both_ways);
            assert!(factor.sums.iter().zip(&unpacked.sums).all(|(a, b)| (a - b).abs() <= 1e-3 * a.abs() + 1e-6));
        }
        assert_eq!((&unpacked.counts, &unpacked.regions), (&evidence.counts, &evidence.regions));
        assert_eq!((unpacked.factors.len(), unpacked.blocks), (2, 40));
    }
}
