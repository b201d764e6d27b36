//! Evidence that waits in memory until a calibration judges it, in half the precision: the more intact rope is held back, the surer
//! is the threshold that follows from it.

use super::evidence::Evidence;
use super::inspection_model::Seen;
use super::unrolled::Unrolled;
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Evidence of a stretch with sums to 11 bits: a 2000th of a sum is far below its noise. Numbers of pixels stay exact up to 2048.
#[derive(Debug, Clone)]
pub struct KeptEvidence {
    /// All but sums and counts.
    rest: Evidence,
    sums: Vec<f16>,
    counts: Vec<f16>,
}

impl KeptEvidence {
    /// What it takes for a place of the unrolled rope: sum, count, region.
    pub const BYTES_PER_PLACE: usize = 5;

    /// Evidence in full precision again.
    pub fn unpacked(&self) -> Evidence {
        let wide = |values: &[f16]| {
            let mut wide = vec![0.0; values.len()];
            values.convert_to_f32_slice(&mut wide);
            wide
        };
        Evidence { sums: wide(&self.sums), counts: wide(&self.counts), ..self.rest.clone() }
    }
}

impl From<Evidence> for KeptEvidence {
    fn from(mut evidence: Evidence) -> Self {
        let narrow = |values: Vec<f32>| {
            let mut narrow = vec![f16::ZERO; values.len()];
            narrow.convert_from_f32_slice(&values);
            narrow
        };
        let (sums, counts) = (std::mem::take(&mut evidence.sums), std::mem::take(&mut evidence.counts));
        Self { rest: evidence, sums: narrow(sums), counts: narrow(counts) }
    }
}

/// All that was seen of a stretch in one view.
#[derive(Debug, Clone)]
pub struct KeptSeen {
    evidence: Vec<KeptEvidence>,
    unrolled: Unrolled,
    margin_blocks: usize,
}

impl KeptSeen {
    /// Bytes that a place of the unrolled rope takes with so many factors.
    pub const fn bytes_per_place(factors: usize) -> usize {
        KeptEvidence::BYTES_PER_PLACE * factors + Unrolled::BYTES_PER_PLACE
    }

    /// Evidence of every factor.
    pub fn evidence(&self) -> &[KeptEvidence] {
        &self.evidence
    }

    /// In full precision again.
    pub fn unpacked(&self) -> Seen {
        let evidence = self.evidence.iter().map(KeptEvidence::unpacked).collect();
        Seen { evidence, unrolled: self.unrolled.clone(), margin_blocks: self.margin_blocks }
    }
}

impl From<Seen> for KeptSeen {
    fn from(seen: Seen) -> Self {
        let evidence = seen.evidence.into_iter().map(KeptEvidence::from).collect();
        Self { evidence, unrolled: seen.unrolled, margin_blocks: seen.margin_blocks }
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
}
