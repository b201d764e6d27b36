//! What recordings must have in common to share a model: the rope, and the camera head that saw it.

use super::Acquisition;
use serde::{Deserialize, Serialize};
use std::fmt;

/// How far nominal angles of a view may lie apart, in rad: mounting a camera head again is no more exact than 1 degree.
const ANGLE_TOLERANCE_RAD: f64 = 0.017_5;
/// How far quantities that people write down may lie apart, as a share: they are rounded, not measured.
pub(super) const ROUNDING: f64 = 1e-6;

/// A rope and the camera head that saw it, as far as a model depends on them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Construction {
    strands: usize,
    wires_per_strand: usize,
    diameter_mm: f64,
    /// Signed; only its hand counts, because lays differ from day to day. `None`: nobody wrote it down.
    strand_lay_mm: Option<f64>,
    /// The same of the wires.
    wire_lay_mm: Option<f64>,
    view_angles_rad: Vec<f64>,
    line_pitch_mm: f64,
}

/// What keeps two recordings from sharing a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// What differs.
    pub quantity: String,
    /// Its value in the first acquisition, or in those that a model was trained on, with unit.
    pub first: String,
    /// And in the other.
    pub other: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {}, but the first one has {}", self.quantity, self.other, self.first)
    }
}

impl Construction {
    /// That of an acquisition.
    pub fn of(acquisition: &Acquisition) -> Self {
        let design = acquisition.rope.design();
        Self {
            strands: design.strands,
            wires_per_strand: design.wires_per_strand,
            diameter_mm: design.diameter_mm,
            strand_lay_mm: design.strand_lay_mm,
            wire_lay_mm: design.wire_lay_mm,
            view_angles_rad: acquisition.view_angles_rad.clone(),
            line_pitch_mm: acquisition.line_pitch_mm,
        }
    }

    /// Number of views.
    pub fn views(&self) -> usize {
        self.view_angles_rad.len()
    }

    /// The first thing in which the other rope differs and must not. Diameters may differ by a share. Lays may, too, only their hand may not.
    pub fn other_rope(&self, other: &Self, diameter_tolerance: f64) -> Option<Difference> {
        count("a number of strands", self.strands, other.strands)
            .or_else(|| count("a number of wires per strand", self.wires_per_strand, other.wires_per_strand))
            .or_else(|| measure("a rope diameter", self.diameter_mm, other.diameter_mm, diameter_tolerance))
            .or_else(|| hand("a strand lay", self.strand_lay_mm, other.strand_lay_mm))
            .or_else(|| hand("a wire lay", self.wire_lay_mm, other.wire_lay_mm))
    }

    /// The first thing in which the other camera head differs and must not. Line pitches may differ by a share.
    pub fn other_head(&self, other: &Self, pitch_tolerance: f64) -> Option<Difference> {
        let angle = |(view, (a, b)): (usize, (&f64, &f64))| {
            let apart_rad = (a - b).sin().atan2((a - b).cos()).abs(); // 359 degrees are next to 0
            (apart_rad > ANGLE_TOLERANCE_RAD).then(|| Difference {
                quantity: format!("an angle of view {view}"),
                first: format!("{:.1} degrees", a.to_degrees()),
                other: format!("{:.1} degrees", b.to_degrees()),
            })
        };
        count("a number of views", self.views(), other.views())
            .or_else(|| self.view_angles_rad.iter().zip(&other.view_angles_rad).enumerate().find_map(angle))
            .or_else(|| measure("a line pitch", self.line_pitch_mm, other.line_pitch_mm, pitch_tolerance))
    }
}

/// Values that must be the same, as they are told.
pub(super) fn differs(quantity: &str, first: String, other: String) -> Option<Difference> {
    (first != other).then(|| Difference { quantity: quantity.to_owned(), first, other })
}

fn count(quantity: &str, first: usize, other: usize) -> Option<Difference> {
    differs(quantity, first.to_string(), other.to_string())
}

/// Lengths that may differ by a share of the first.
fn measure(quantity: &str, first_mm: f64, other_mm: f64, tolerance: f64) -> Option<Difference> {
    let same = (first_mm - other_mm).abs() <= tolerance * first_mm.abs();
    (!same).then(|| Difference {
        quantity: quantity.to_owned(),
        first: format!("{first_mm} mm"),
        other: format!("{other_mm} mm"),
    })
}

fn hand(quantity: &str, first_mm: Option<f64>, other_mm: Option<f64>) -> Option<Difference> {
    let name = |lay_mm: f64| if lay_mm > 0.0 { "right-hand" } else { "left-hand" }.to_owned();
    // Where nobody wrote it down, nothing contradicts.
    first_mm.zip(other_mm).and_then(|(first_mm, other_mm)| differs(quantity, name(first_mm), name(other_mm)))
}
