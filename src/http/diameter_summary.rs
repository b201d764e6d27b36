//! Diameter, ovality and looseness of a rope in a few figures, beside its inspection.

use crate::pipeline::diameters;
use serde::Serialize;
use utoipa::ToSchema;

/// A value and where it was found.
#[derive(Debug, Serialize, ToSchema)]
pub struct ValueAt {
    /// The value, in the unit of its field.
    value: f64,
    /// Its standard deviation.
    sd: f64,
    /// Rope metre of the middle of the stretch.
    position_m: f64,
}

/// Diameter, ovality and looseness along the rope.
#[derive(Debug, Serialize, ToSchema)]
pub struct DiameterSummary {
    /// Whether the scale of the cameras was measured. If not, diameters are relative to the nominal one over the first metre of rope.
    absolute: bool,
    /// Mean diameter in mm.
    mean_mm: f64,
    /// Smallest diameter of a stretch in mm.
    smallest_mm: ValueAt,
    /// Largest diameter of a stretch in mm.
    largest_mm: ValueAt,
    /// Largest ovality in percent of the diameter; null if all cameras look in one direction.
    #[schema(required)]
    ovality_percent: Option<ValueAt>,
    /// Largest looseness in rad; null if it was measured nowhere.
    #[schema(required)]
    strand_spread_rad: Option<ValueAt>,
}

impl From<diameters::Place> for ValueAt {
    fn from(place: diameters::Place) -> Self {
        Self { value: place.value, sd: place.sd, position_m: place.position_m }
    }
}

impl From<diameters::DiameterSummary> for DiameterSummary {
    fn from(summary: diameters::DiameterSummary) -> Self {
        Self {
            absolute: summary.absolute,
            mean_mm: summary.mean_mm,
            smallest_mm: summary.smallest_mm.into(),
            largest_mm: summary.largest_mm.into(),
            ovality_percent: summary.ovality_percent.map(Into::into),
            strand_spread_rad: summary.strand_spread_rad.map(Into::into),
        }
    }
}
