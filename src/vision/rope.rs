//! The rope as designed: how many strands and wires, how thick, how long their lays. [Wacker13, sec. 3.1, fig. 3a]

use std::f64::consts::PI;
use std::fmt;

/// Fewest and most strands of a rope that the method is made for.
pub const STRANDS: std::ops::RangeInclusive<usize> = 3..=8;
/// Fewest and most outer wires of a strand that the method is made for.
pub const WIRES: std::ops::RangeInclusive<usize> = 5..=16;
/// Diameters of ropes people build, in mm.
pub const DIAMETER_MM: std::ops::RangeInclusive<f64> = 1.0..=200.0;
/// Allowed |strand lay| in rope diameters. Ropes in service have 5 to 9; the rest is room for odd constructions.
pub const STRAND_LAY_DIAMETERS: std::ops::RangeInclusive<f64> = 3.0..=15.0;
/// Allowed |wire lay| in strand diameters, measured against the fixed axes.
pub const WIRE_LAY_STRAND_DIAMETERS: std::ops::RangeInclusive<f64> = 4.0..=60.0;
/// How far stated diameters may exceed the space that the geometry leaves, as a ratio: rope makers round.
const FIT_TOLERANCE: f64 = 1.03;

/// A rope as somebody entered it; nothing is checked yet.
#[derive(Debug, Clone, PartialEq)]
pub struct RopeDesign {
    /// Number of strands N.
    pub strands: usize,
    /// Number of outer wires per strand M.
    pub wires_per_strand: usize,
    /// Rope diameter in mm.
    pub diameter_mm: f64,
    /// Nominal strand lay length in mm, signed (+ right-hand); `None` if unknown.
    pub strand_lay_mm: Option<f64>,
    /// Nominal wire lay length in mm against the fixed axes (eq. 3), signed; `None` if unknown.
    pub wire_lay_mm: Option<f64>,
    /// Strand diameter in mm where the maker states it; else it follows from `diameter_mm`.
    pub strand_diameter_mm: Option<f64>,
    /// Wire diameter in mm where the maker states it; else it follows from the strand diameter.
    pub wire_diameter_mm: Option<f64>,
}

/// One reason why a design is no rope, with the value and the limit.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields' names carry meaning and unit")]
pub enum Violation {
    /// A quantity lies outside its interval.
    OutOfRange { quantity: &'static str, value: f64, min: f64, max: f64 },
    /// The strands do not fit into the rope.
    StrandsDoNotFit { strands: usize, strand_diameter_mm: f64, largest_mm: f64, diameter_mm: f64 },
    /// The wires do not fit around their strand.
    WiresDoNotFit { wires: usize, wire_diameter_mm: f64, largest_mm: f64, strand_diameter_mm: f64 },
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { quantity, value, min, max } => {
                write!(f, "{quantity} is {value}, but must lie between {min} and {max}")
            }
            Self::StrandsDoNotFit { strands, strand_diameter_mm, largest_mm, diameter_mm } => write!(
                f,
                "{strands} strands of {strand_diameter_mm} mm do not fit into a rope of {diameter_mm} mm: at most {largest_mm:.2} mm each"
            ),
            Self::WiresDoNotFit { wires, wire_diameter_mm, largest_mm, strand_diameter_mm } => write!(
                f,
                "{wires} wires of {wire_diameter_mm} mm do not fit around a strand of {strand_diameter_mm:.2} mm: at most {largest_mm:.2} mm each"
            ),
        }
    }
}

/// Everything that is wrong with a design, at once.
#[derive(Debug, Clone, PartialEq)]
pub struct RopeDesignError(pub Vec<Violation>);

impl fmt::Display for RopeDesignError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, violation) in self.0.iter().enumerate() {
            write!(f, "{}{violation}", if n > 0 { "; " } else { "" })?;
        }
        Ok(())
    }
}

impl std::error::Error for RopeDesignError {}

/// A rope that can exist: a validated [`RopeDesign`] with the radii that follow from it.
#[derive(Debug, Clone, PartialEq)]
pub struct Rope {
    design: RopeDesign,
    strand_curve_radius_mm: f64,
    strand_radius_mm: f64,
    wire_curve_radius_mm: f64,
    wire_radius_mm: f64,
}

/// Radius of the circle on which the centres of `n` touching circles of diameter 1 lie.
///
/// Figure 3a: sin(beta)/sin(alpha) with alpha = 2 pi/n, beta = (pi - alpha)/2, which is 1/(2 sin(pi/n)).
///
/// ```
/// # use ropescope::vision::rope::ring_radius;
/// assert!((ring_radius(6) - 1.0).abs() < 1e-12); // six coins round a seventh
/// ```
pub fn ring_radius(n: usize) -> f64 {
    let alpha = 2.0 * PI / n as f64;
    let beta = (PI - alpha) / 2.0;
    beta.sin() / alpha.sin()
}

impl RopeDesign {
    /// Checks the design and derives its radii. Errors: every violation with its value and limit.
    pub fn validate(self) -> Result<Rope, RopeDesignError> {
        let mut violations = Vec::new();
        let mut in_range = |quantity, value: f64, min: f64, max: f64| {
            let inside = value >= min && value <= max; // false for NaN
            if !inside {
                violations.push(Violation::OutOfRange { quantity, value, min, max });
            }
            inside
        };
        let counts = in_range("strands", self.strands as f64, *STRANDS.start() as f64, *STRANDS.end() as f64)
            & in_range("wires_per_strand", self.wires_per_strand as f64, *WIRES.start() as f64, *WIRES.end() as f64)
            & in_range("rope_diameter_mm", self.diameter_mm, *DIAMETER_MM.start(), *DIAMETER_MM.end());
        if !counts {
            return Err(RopeDesignError(violations)); // the rest is derived from these
        }
        // R = r_s + strand radius, and r_s = ring_radius(N) * strand diameter.
        let largest_strand_mm = self.diameter_mm / (2.0 * ring_radius(self.strands) + 1.0);
        let strand_diameter_mm = self.strand_diameter_mm.unwrap_or(largest_strand_mm);
        let largest_wire_mm = strand_diameter_mm / (2.0 * ring_radius(self.wires_per_strand) + 1.0);
        let wire_diameter_mm = self.wire_diameter_mm.unwrap_or(largest_wire_mm);
        in_range("strand_diameter_mm", strand_diameter_mm, 0.1, self.diameter_mm);
        in_range("wire_diameter_mm", wire_diameter_mm, 0.01, self.diameter_mm);
        if let Some(lay) = self.strand_lay_mm {
            in_range(
                "|strand_lay_mm|",
                lay.abs(),
                STRAND_LAY_DIAMETERS.start() * self.diameter_mm,
                STRAND_LAY_DIAMETERS.end() * self.diameter_mm,
            );
        }
        if let Some(lay) = self.wire_lay_mm {
            in_range(
                "|wire_lay_mm|",
                lay.abs(),
                WIRE_LAY_STRAND_DIAMETERS.start() * largest_strand_mm,
                WIRE_LAY_STRAND_DIAMETERS.end() * largest_strand_mm,
            );
        }
        if strand_diameter_mm > largest_strand_mm * FIT_TOLERANCE {
            violations.push(Violation::StrandsDoNotFit {
                strands: self.strands,
                strand_diameter_mm,
                largest_mm: largest_strand_mm,
                diameter_mm: self.diameter_mm,
            });
        }
        if wire_diameter_mm > largest_wire_mm * FIT_TOLERANCE {
            violations.push(Violation::WiresDoNotFit {
                wires: self.wires_per_strand,
                wire_diameter_mm,
                largest_mm: largest_wire_mm,
                strand_diameter_mm,
            });
        }
        if !violations.is_empty() {
            return Err(RopeDesignError(violations));
        }
        let strand_radius_mm = strand_diameter_mm / 2.0;
        let wire_radius_mm = wire_diameter_mm / 2.0;
        Ok(Rope {
            strand_curve_radius_mm: self.diameter_mm / 2.0 - strand_radius_mm,
            strand_radius_mm,
            wire_curve_radius_mm: strand_radius_mm - wire_radius_mm,
            wire_radius_mm,
            design: self,
        })
    }
}

impl Rope {
    /// The design that was validated.
    pub fn design(&self) -> &RopeDesign {
        &self.design
    }
    /// Number of strands N.
    pub fn strands(&self) -> usize {
        self.design.strands
    }
    /// Number of outer wires per strand M.
    pub fn wires(&self) -> usize {
        self.design.wires_per_strand
    }
    /// Rope diameter in mm.
    pub fn diameter_mm(&self) -> f64 {
        self.design.diameter_mm
    }
    /// Radius of the strand space curves r_s in mm.
    pub fn strand_curve_radius_mm(&self) -> f64 {
        self.strand_curve_radius_mm
    }
    /// Radius of a strand's outside in mm.
    pub fn strand_radius_mm(&self) -> f64 {
        self.strand_radius_mm
    }
    /// Radius of the wire space curves about the strand's axis r_w in mm.
    pub fn wire_curve_radius_mm(&self) -> f64 {
        self.wire_curve_radius_mm
    }
    /// Radius of a wire in mm.
    pub fn wire_radius_mm(&self) -> f64 {
        self.wire_radius_mm
    }
    /// Phase between neighbouring strands k_s = 2 pi/N in rad (eq. 2).
    pub fn strand_step_rad(&self) -> f64 {
        2.0 * PI / self.strands() as f64
    }
    /// Phase between neighbouring wires k_w = 2 pi/M in rad (eq. 3).
    pub fn wire_step_rad(&self) -> f64 {
        2.0 * PI / self.wires() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn design() -> RopeDesign {
        RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm: Some(220.0),
            wire_lay_mm: Some(-95.0),
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
    }

    #[test]
    fn radii_follow_from_touching_circles() {
        let rope = design().validate().unwrap();
        assert!((rope.strand_radius_mm() - 32.0 / 6.0).abs() < 1e-12); // six strands: a third of the rope each
        assert!((rope.strand_curve_radius_mm() - 32.0 / 3.0).abs() < 1e-12);
        let touching = 2.0 * rope.wire_curve_radius_mm() * (PI / 9.0).sin();
        assert!((touching - 2.0 * rope.wire_radius_mm()).abs() < 1e-12);
    }

    #[test]
    fn wires_that_cannot_fit_are_refused_with_value_and_limit() {
        let error = RopeDesign { wire_diameter_mm: Some(4.0), ..design() }.validate().unwrap_err();
        assert_eq!(error.to_string(), "9 wires of 4 mm do not fit around a strand of 10.67 mm: at most 2.72 mm each");
    }

    #[test]
    fn all_violations_are_named_at_once() {
        let error =
            RopeDesign { strand_lay_mm: Some(10.0), wire_lay_mm: Some(f64::NAN), ..design() }.validate().unwrap_err();
        assert_eq!(error.0.len(), 2);
        let error = RopeDesign { strands: 0, ..design() }.validate().unwrap_err();
        assert_eq!(error.to_string(), "strands is 0, but must lie between 3 and 8");
    }
}
