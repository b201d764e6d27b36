//! Which estimates can be relied on: one rule for strands, wires and diameters.

use super::results::{LayLengthRow, WireEstimate};
use serde::{Deserialize, Serialize};

/// How far an estimate can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// A change of 1 % would show at four standard deviations.
    Good,
    /// It would not.
    Uncertain,
}

impl Quality {
    /// Largest standard deviation of a good estimate, as a share of it. Inspectors ask for changes of a percent.
    const GOOD_SD: f64 = 0.0025;

    /// Of an estimate and its standard deviation; `None` without an estimate.
    pub fn of(value: Option<f64>, sd: Option<f64>) -> Option<Self> {
        let value = value?;
        let good = sd.is_some_and(|sd| sd <= Self::GOOD_SD * value.abs());
        Some(if good { Self::Good } else { Self::Uncertain })
    }

    /// As tables write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Uncertain => "uncertain",
        }
    }
}

impl LayLengthRow {
    /// Of the strand lay length.
    pub fn strand_quality(&self) -> Option<Quality> {
        Quality::of(self.strand_lay_mm, self.strand_lay_sd_mm)
    }

    /// Of the diameter.
    pub fn diameter_quality(&self) -> Option<Quality> {
        Quality::of(self.diameter_mm, self.diameter_sd_mm)
    }
}

impl WireEstimate {
    /// Of the wire lay length.
    pub fn quality(&self) -> Option<Quality> {
        Quality::of(self.lay_mm, self.lay_sd_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_good_estimate_shows_one_percent_at_four_standard_deviations() {
        assert_eq!(Quality::of(Some(-95.0), Some(0.23)), Some(Quality::Good));
        assert_eq!(Quality::of(Some(-95.0), Some(0.24)), Some(Quality::Uncertain));
        assert_eq!(Quality::of(Some(-95.0), None), Some(Quality::Uncertain), "nobody knows how good it is");
        assert_eq!(Quality::of(None, Some(0.1)), None);
    }
}
