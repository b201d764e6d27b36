//! What a recipe must keep to, and what is said when it does not.

use super::recipe::Recipe;
use crate::vision::rope::{Rope, RopeDesign, RopeDesignError};

/// Why a recipe cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RecipeError {
    /// The rope cannot exist.
    #[error("the rope design is not possible: {0}")]
    Design(#[from] RopeDesignError),
    /// An option lies outside its interval.
    #[error("{option} is {value}, but must lie between {min} and {max}")]
    OutOfRange {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// The least.
        min: f64,
        /// The most.
        max: f64,
    },
    /// The defects do not fit.
    #[error(
        "{defects} defects need {needed_m:.1} m of rope, but between --defect-free-m {free_m} and the end at {metres} m there are only {left_m:.1} m: simulate more metres or fewer defects"
    )]
    NoRoomForDefects {
        /// How many.
        defects: usize,
        /// Rope they need in m.
        needed_m: f64,
        /// First part without defects in m.
        free_m: f64,
        /// Length of rope in m.
        metres: f64,
        /// What is left in m.
        left_m: f64,
    },
}

/// Rope that a defect has for itself, or with those at the same metre, in m: the longest (a missing wire) and a margin.
pub const METRES_PER_DEFECT: f64 = 0.15;

impl Recipe {
    /// Metres of the rope that have defects.
    pub(super) fn defect_sites(&self) -> usize {
        self.defects.div_ceil(self.defects_at_once.max(1))
    }

    /// Checks every option. Errors: all that is wrong with the design, or the first option out of its interval.
    pub fn validate(&self) -> Result<Rope, RecipeError> {
        let rope = RopeDesign {
            strands: self.strands,
            wires_per_strand: self.wires_per_strand,
            diameter_mm: self.diameter_mm,
            strand_lay_mm: Some(self.strand_lay_mm),
            wire_lay_mm: Some(self.wire_lay_mm),
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()?;
        let checks = [
            ("metres", self.metres, 0.01, 100_000.0),
            ("line_pitch_mm", self.line_pitch_mm, 0.01, 1.0),
            ("frame_lines", self.frame_lines as f64, 16.0, 65_536.0),
            ("sensor_px", f64::from(self.sensor_px), 64.0, 8192.0),
            ("rope_width_px", self.rope_width_px, 32.0, f64::from(self.sensor_px) * 0.95),
            ("camera_distance_mm", self.camera_distance_mm, 2.0 * self.diameter_mm, 1000.0 * self.diameter_mm),
            ("number of views", self.view_angles_deg.len() as f64, 1.0, 8.0),
            ("diameter_change", self.diameter_change, -0.1, 0.1),
            ("ovality", self.ovality, 0.0, 0.1),
            ("strand_lay_drift_mm", self.strand_lay_drift_mm, 0.0, 0.3 * self.strand_lay_mm.abs()),
            ("wire_lay_drift_mm", self.wire_lay_drift_mm, 0.0, 0.3 * self.wire_lay_mm.abs()),
            ("drift_wave_m", self.drift_wave_m, 0.1, 1000.0),
            ("start_m", self.start_m, -1e6, 1e6),
            ("gray_noise", self.gray_noise, 0.0, 100.0),
            ("contour_noise_px", self.contour_noise_px, 0.0, 50.0),
            ("oscillation_px", self.oscillation_px, 0.0, (f64::from(self.sensor_px) - self.rope_width_px) / 2.0),
            ("encoder_jitter_mm", self.encoder_jitter_mm, 0.0, 1.0),
            ("strand_jitter_rad", self.strand_jitter_rad, 0.0, 0.3),
            ("dirt", self.dirt, 0.0, 1.0),
            ("oil_spots_per_m", self.oil_spots_per_m, 0.0, 200.0),
            ("water", self.water, 0.0, 1.0),
            ("scratches_per_m", self.scratches_per_m, 0.0, 1000.0),
            ("debris_per_m", self.debris_per_m, 0.0, 1000.0),
            ("exposure", self.exposure, 0.05, 5.0),
            ("gloss", self.gloss, 0.0, 4.0),
            ("lamp_spread", self.lamp_spread, 0.0, 3.0),
            ("blur_px", self.blur_px, 0.1, 1.0),
            ("light_drift", self.light_drift, 0.0, 0.9),
            ("vignetting", self.vignetting, 0.0, 0.9),
            ("bad_columns", self.bad_columns as f64, 0.0, f64::from(self.sensor_px) / 8.0),
            ("defects_at_once", self.defects_at_once as f64, 1.0, self.strands as f64),
            ("defect_free_m", self.defect_free_m, 0.0, self.metres),
            ("defect_variety", self.defect_variety, 0.0, 1.0),
        ];
        for (option, value, min, max) in checks {
            if !(value >= min && value <= max) {
                return Err(RecipeError::OutOfRange { option, value, min, max });
            }
        }
        for &angle in &self.view_angles_deg {
            if !(-360.0..=360.0).contains(&angle) {
                return Err(RecipeError::OutOfRange { option: "angle_deg", value: angle, min: -360.0, max: 360.0 });
            }
        }
        let (needed_m, left_m) = (self.defect_sites() as f64 * METRES_PER_DEFECT, self.metres - self.defect_free_m);
        if needed_m > left_m {
            return Err(RecipeError::NoRoomForDefects {
                defects: self.defects,
                needed_m,
                free_m: self.defect_free_m,
                metres: self.metres,
                left_m,
            });
        }
        Ok(rope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_recipes_are_valid_and_so_is_every_construction() {
        for recipe in [Recipe::photographic(), Recipe::artificial()] {
            recipe.validate().unwrap();
            for strands in 3..=8 {
                for wires in 5..=16 {
                    recipe.clone().with_construction(strands, wires, 24.0).validate().unwrap();
                }
            }
        }
    }

    #[test]
    fn errors_name_value_and_limit() {
        let error = Recipe { dirt: 2.0, ..Recipe::photographic() }.validate().unwrap_err();
        assert_eq!(error.to_string(), "dirt is 2, but must lie between 0 and 1");
        let error = Recipe { metres: 1.0, defects: 9, ..Recipe::photographic() }.validate().unwrap_err();
        assert!(error.to_string().contains("simulate more metres or fewer defects"), "{error}");
        assert!(Recipe { metres: f64::NAN, ..Recipe::photographic() }.validate().is_err());
    }
}
