//! Diameter, ovality and looseness of a rope in a few figures.

use super::Acquisition;
use super::results::LayLengthRow;
use serde::{Deserialize, Serialize};

/// A value and where it was found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// The value, in the unit of its field.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
    /// Rope metre of the middle of the stretch.
    pub position_m: f64,
}

/// What the fused estimates of all stretches say of the rope's shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiameterSummary {
    /// Whether the scale of the cameras was measured. If not, diameters are relative to the nominal one, which the first metre of rope
    /// is taken to have.
    pub absolute: bool,
    /// Mean diameter in mm.
    pub mean_mm: f64,
    /// Smallest diameter of a stretch in mm.
    pub smallest_mm: Place,
    /// Largest diameter of a stretch in mm.
    pub largest_mm: Place,
    /// Largest ovality in percent of the diameter; `None` if all cameras look in one direction.
    pub ovality_percent: Option<Place>,
    /// Largest looseness, root mean square of the strands' deviations from their regular places, in rad.
    pub strand_spread_rad: Option<Place>,
}

/// Gathers them while the rope goes by.
#[derive(Debug, Default)]
pub struct DiameterExtremes {
    sum_mm: f64,
    stretches: usize,
    smallest_mm: Option<Place>,
    largest_mm: Option<Place>,
    ovality_percent: Option<Place>,
    strand_spread_rad: Option<Place>,
}

impl DiameterExtremes {
    /// Looks at a row; those of single views say nothing new.
    pub fn add(&mut self, row: &LayLengthRow) {
        if row.view.is_some() {
            return;
        }
        let place = |value: Option<f64>, sd: Option<f64>| {
            Some(Place { value: value?, sd: sd?, position_m: row.position_m }).filter(|place| place.value.is_finite())
        };
        let keep = |kept: &mut Option<Place>, now: Option<Place>, sign: f64| {
            if let Some(now) = now
                && kept.is_none_or(|kept| sign * now.value > sign * kept.value)
            {
                *kept = Some(now);
            }
        };
        let diameter_mm = place(row.diameter_mm, row.diameter_sd_mm);
        if let Some(diameter) = diameter_mm {
            self.sum_mm += diameter.value;
            self.stretches += 1;
        }
        keep(&mut self.smallest_mm, diameter_mm, -1.0);
        keep(&mut self.largest_mm, diameter_mm, 1.0);
        keep(&mut self.ovality_percent, place(row.ovality_percent, row.ovality_sd_percent), 1.0);
        keep(&mut self.strand_spread_rad, place(row.strand_spread_rad, row.strand_spread_sd_rad), 1.0);
    }

    /// The figures; `None` if no diameter was measured.
    pub fn summary(&self, acquisition: &Acquisition) -> Option<DiameterSummary> {
        Some(DiameterSummary {
            absolute: acquisition.is_calibrated(),
            mean_mm: self.sum_mm / self.stretches as f64,
            smallest_mm: self.smallest_mm?,
            largest_mm: self.largest_mm?,
            ovality_percent: self.ovality_percent,
            strand_spread_rad: self.strand_spread_rad,
        })
    }
}

impl DiameterSummary {
    /// What somebody who reads these diameters must know, if anything.
    pub fn note(&self) -> Option<String> {
        (!self.absolute).then(|| {
            "diameters and ovality are relative to the nominal diameter over the first metre of rope, because no px_per_mm of the \
             views is given"
                .to_owned()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extremes_are_those_of_the_fused_rows_with_their_places() {
        let row = |view, position_m, diameter_mm: Option<f64>| LayLengthRow {
            view,
            position_m,
            diameter_mm,
            diameter_sd_mm: Some(0.03),
            ovality_percent: diameter_mm.map(|mm| mm - 31.0),
            ovality_sd_percent: Some(0.1),
            ..LayLengthRow::default()
        };
        let mut extremes = DiameterExtremes::default();
        for (view, position_m, mm) in
            [(None, 0.1, Some(32.0)), (Some(0), 0.1, Some(99.0)), (None, 0.3, None), (None, 0.5, Some(31.5))]
        {
            extremes.add(&row(view, position_m, mm));
        }
        let found = (extremes.smallest_mm.unwrap(), extremes.largest_mm.unwrap(), extremes.ovality_percent.unwrap());
        assert_eq!((found.0.value, found.0.position_m), (31.5, 0.5));
        assert_eq!((found.1.value, found.1.position_m), (32.0, 0.1));
        assert_eq!((found.2.value, found.2.position_m), (1.0, 0.1));
        assert_eq!((extremes.stretches, extremes.strand_spread_rad), (2, None));
    }
}
