//! What a defect is likely to be, as the API tells it.

use crate::pipeline::results;
use serde::Serialize;
use utoipa::ToSchema;

/// What a defect is likely to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DefectKind {
    /// A wire is interrupted.
    Gap,
    /// A wire is not there over a longer stretch.
    MissingWire,
    /// A wire stands out of the rope.
    ProtrudingWire,
    /// The surface is changed: worn, corroded, burnt, cut.
    SurfaceChange,
    /// The figures decide for nothing.
    Unclear,
}

impl From<results::Kind> for DefectKind {
    fn from(kind: results::Kind) -> Self {
        match kind {
            results::Kind::Gap => Self::Gap,
            results::Kind::MissingWire => Self::MissingWire,
            results::Kind::ProtrudingWire => Self::ProtrudingWire,
            results::Kind::SurfaceChange => Self::SurfaceChange,
            results::Kind::Unclear => Self::Unclear,
        }
    }
}

/// What a defect is likely to be, with the figures that say so. People decide.
#[derive(Debug, Serialize, ToSchema)]
pub struct Suggestion {
    /// The kind.
    kind: DefectKind,
    /// Why, in words.
    why: String,
    /// Length of what is over the threshold along the rope, in the view and on the strand with the peak, reach of the filters
    /// included.
    length_mm: f64,
    /// Mean width of it across the wires, in wires.
    width_wires: f64,
    /// Surface of it as that view sees it.
    area_mm2: f64,
    /// Mean deviation from the expected gray on the wire with the peak, in steps of the 32 of the model's gray scale; negative is darker.
    gray_steps: f64,
    /// Change of gray along that wire, as a multiple of that of the rope beside it.
    texture: f64,
    /// Farthest that the rope's edge is outside the model's outline in any view.
    beyond_outline_mm: f64,
}

impl From<results::Suggestion> for Suggestion {
    fn from(s: results::Suggestion) -> Self {
        Self {
            kind: s.kind.into(),
            why: s.why,
            length_mm: s.length_mm,
            width_wires: s.width_wires,
            area_mm2: s.area_mm2,
            gray_steps: s.gray_steps,
            texture: s.texture,
            beyond_outline_mm: s.beyond_outline_mm,
        }
    }
}
