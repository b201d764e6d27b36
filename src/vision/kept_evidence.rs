//! Evidence that waits in memory until a calibration judges it, in half the precision: the more intact rope is held back, the surer
//! is the threshold that follows from it.

use super::camera::Camera;
use super::estimates::Estimates;
use super::evidence::{Evidence, UNSEEN};
use super::inspection_model::{AlignedView, Seen};
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::unrolled::Unrolled;
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Evidence of a stretch with sums to 11 bits: a 2000th of a sum is far below its noise. Numbers of pixels stay exact up to 2048.
#[derive(Debug, Clone)]
pub struct KeptEvidence {
    /// All but sums and counts.
    rest: Evidence,
    sums: Vec<f16>,
    /// Empty where every place that was seen counts once, as places of further factors do.
    counts: Vec<f16>,
}

impl KeptEvidence {
    /// Evidence in full precision again.
    pub fn unpacked(&self) -> Evidence {
        let wide = |values: &[f16]| {
            let mut wide = vec![0.0; values.len()];
            values.convert_to_f32_slice(&mut wide);
            wide
        };
        let once = || self.rest.regions.iter().map(|&region| once(region)).collect();
        let counts = if self.counts.is_empty() { once() } else { wide(&self.counts) };
        Evidence { sums: wide(&self.sums), counts, ..self.rest.clone() }
    }
}

impl From<Evidence> for KeptEvidence {
    fn from(mut evidence: Evidence) -> Self {
        let narrow = |values: Vec<f32>| {
            let mut narrow = vec![f16::ZERO; values.len()];
            narrow.convert_from_f32_slice(&values);
            narrow
        };
        let (sums, mut counts) = (std::mem::take(&mut evidence.sums), std::mem::take(&mut evidence.counts));
        if counts.iter().zip(&evidence.regions).all(|(&count, &region)| count == once(region)) {
            counts.clear();
        }
        Self { rest: evidence, sums: narrow(sums), counts: narrow(counts) }
    }
}

/// How often a place counts that counts once if it was seen.
fn once(region: u8) -> f32 {
    if region == UNSEEN { 0.0 } else { 1.0 }
}

/// All that was seen of a stretch in one view.
#[derive(Debug, Clone)]
pub struct KeptSeen {
    evidence: Vec<KeptEvidence>,
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
    /// Bytes that a place of the unrolled rope takes with so many factors: sums and regions of all, and counts of the first.
    pub const fn bytes_per_place(factors: usize) -> usize {
        3 * factors + 2 + Unrolled::BYTES_PER_PLACE
    }

    /// Evidence of every factor.
    pub fn evidence(&self) -> &[KeptEvidence] {
        &self.evidence
    }

    /// What was seen in an image.
    pub fn new(seen: Seen, image: KeptImage) -> Self {
        let evidence = seen.evidence.into_iter().map(KeptEvidence::from).collect();
        Self { evidence, unrolled: seen.unrolled, margin_blocks: seen.margin_blocks, image }
    }

    /// Blocks at either end that belong to the stretches before and after it.
    pub fn margin_blocks(&self) -> usize {
        self.margin_blocks
    }

    /// The image.
    pub fn image<'a>(&'a self, rope: &'a Rope) -> AlignedView<'a> {
        let KeptImage { camera, estimates, view, block_lines, pitch_mm } = &self.image;
        AlignedView { rope, camera, estimates, view, block_lines: *block_lines, pitch_mm: *pitch_mm }
    }

    /// In full precision again.
    pub fn unpacked(&self) -> Seen {
        let evidence = self.evidence.iter().map(KeptEvidence::unpacked).collect();
        Seen { evidence, unrolled: self.unrolled.clone(), margin_blocks: self.margin_blocks }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_is_what_it_was_to_a_thousandth() {
        let mut evidence = Evidence::empty(5, 40, 2, 35);
        evidence.both_ways = true;
        for at in 0..40 * 2 * 35 {
            evidence.set(at, (at as f32 * 0.37).sin() * 600.0, (at % 300) as f32, (at % 9) as u8);
        }
        let unpacked = KeptEvidence::from(evidence.clone()).unpacked();
        assert!(evidence.sums.iter().zip(&unpacked.sums).all(|(a, b)| (a - b).abs() <= 1e-3 * a.abs() + 1e-6));
        assert_eq!((&unpacked.counts, &unpacked.regions), (&evidence.counts, &evidence.regions));
        assert_eq!((unpacked.both_ways, unpacked.blocks), (true, 40));
    }

    #[test]
    fn counts_of_places_that_count_once_take_no_room() {
        let mut evidence = Evidence::empty(5, 4, 1, 35);
        (0..70).for_each(|at| evidence.set(2 * at, 1.5, 1.0, 3));
        let kept = KeptEvidence::from(evidence.clone());
        assert!(kept.counts.is_empty());
        assert_eq!(kept.unpacked().counts, evidence.counts);
    }
}
