//! The tables of an inspection and the results folder that holds them (design: lay lengths, displacement, line scores, defects, summary).

use super::diameters::DiameterSummary;
use super::fit::ModelFit;
use crate::vision::kind::{self, Figures};
use serde::{Deserialize, Serialize};

/// One stretch of rope as one view saw it, or all views together.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LayLengthRow {
    /// The view; `None` for the estimate fused over all views.
    pub view: Option<usize>,
    /// First line of the stretch.
    pub first_line: usize,
    /// Last line of the stretch.
    pub last_line: usize,
    /// Rope metre of the middle line.
    pub position_m: f64,
    /// Strand lay length in mm, signed; `None` if it could not be estimated.
    pub strand_lay_mm: Option<f64>,
    /// Its standard deviation in mm.
    pub strand_lay_sd_mm: Option<f64>,
    /// Phase of strand 0 at the middle line in rad, rope axes.
    pub strand_phase_rad: Option<f64>,
    /// Its standard deviation in rad.
    pub strand_phase_sd_rad: Option<f64>,
    /// Agreement of contours and model, 1 is perfect (eq. 13, mean of both contours).
    pub strand_score: Option<f64>,
    /// Looseness: root mean square of the strands' deviations from their regular places in rad. Fused estimate only.
    pub strand_spread_rad: Option<f64>,
    /// Its standard deviation in rad.
    pub strand_spread_sd_rad: Option<f64>,
    /// Rope diameter in mm: of a view the distance of its two contours, of all views the mean over the directions.
    pub diameter_mm: Option<f64>,
    /// Its standard deviation in mm.
    pub diameter_sd_mm: Option<f64>,
    /// Largest less smallest diameter in percent of their mean. Fused estimate only, and only where cameras look from two directions.
    pub ovality_percent: Option<f64>,
    /// Its standard deviation in percent of the diameter.
    pub ovality_sd_percent: Option<f64>,
    /// One entry a strand.
    pub wires: Vec<WireEstimate>,
    /// Why estimates are absent; `None` when nothing is.
    pub reason: Option<String>,
}

/// The wires of one strand over a stretch.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct WireEstimate {
    /// Wire lay length in mm, signed, against the fixed axes.
    pub lay_mm: Option<f64>,
    /// Its standard deviation in mm.
    pub lay_sd_mm: Option<f64>,
    /// Phase of wire 0 at the middle line in rad.
    pub phase_rad: Option<f64>,
    /// Its standard deviation in rad.
    #[serde(default)]
    pub phase_sd_rad: Option<f64>,
    /// Agreement of image and model, 1 is perfect (eq. 14).
    pub score: Option<f64>,
}

/// A run of lines of one view in which one strand is over the threshold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlarmRow {
    /// The view.
    pub view: usize,
    /// The strand; `None` in results of before alarms had one.
    #[serde(default)]
    pub strand: Option<usize>,
    /// First line.
    pub first_line: usize,
    /// Last line.
    pub last_line: usize,
    /// First column.
    pub first_column: usize,
    /// Last column.
    pub last_column: usize,
    /// Highest score of the strand in it.
    pub peak_score: f64,
}

/// What a defect is likely to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
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

impl Kind {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gap => "gap",
            Self::MissingWire => "missing_wire",
            Self::ProtrudingWire => "protruding_wire",
            Self::SurfaceChange => "surface_change",
            Self::Unclear => "unclear",
        }
    }
}

/// What a defect is likely to be, with the figures that say so. People decide.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Suggestion {
    /// The kind.
    pub kind: Kind,
    /// Why, in words.
    pub why: String,
    /// Length of what is over the threshold along the rope in mm, in the view and on the strand with the peak, reach of the
    /// filters included.
    pub length_mm: f64,
    /// Mean width of it across the wires, in wires.
    pub width_wires: f64,
    /// Surface of it as that view sees it on all strands, in mm2.
    pub area_mm2: f64,
    /// Mean deviation from the expected gray on the wire with the peak, in steps of the 32 of the model's gray scale; negative is darker.
    pub gray_steps: f64,
    /// Change of gray along that wire, as a multiple of that of the rope beside it.
    pub texture: f64,
    /// Farthest that the rope's edge is outside the model's outline in any view, in mm.
    pub beyond_outline_mm: f64,
}

impl From<Figures> for Suggestion {
    fn from(figures: Figures) -> Self {
        let (kind, why) = figures.kind();
        Self {
            kind: match kind {
                kind::Kind::Gap => Kind::Gap,
                kind::Kind::MissingWire => Kind::MissingWire,
                kind::Kind::ProtrudingWire => Kind::ProtrudingWire,
                kind::Kind::SurfaceChange => Kind::SurfaceChange,
                kind::Kind::Unclear => Kind::Unclear,
            },
            why,
            length_mm: figures.length_mm,
            width_wires: figures.width_wires,
            area_mm2: figures.area_mm2,
            gray_steps: figures.gray_steps,
            texture: figures.texture,
            beyond_outline_mm: figures.beyond_outline_mm,
        }
    }
}

/// How sure it is that something is there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// Over the threshold: a defect.
    #[default]
    Alarm,
    /// Over the second level only: worth looking at again.
    LookAgain,
}

/// Alarms of one cause, merged over lines, wires, strands and views.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DefectRow {
    /// Number within the inspection, from 0: defects along the rope, then places to look at again along it.
    pub id: usize,
    /// Which threshold it is over.
    #[serde(default)]
    pub level: Level,
    /// Rope metre where it begins.
    pub from_m: f64,
    /// Rope metre where it ends.
    pub to_m: f64,
    /// Strand, if it is known.
    pub strand: Option<usize>,
    /// Wire in the strand, if it is known.
    pub wire: Option<usize>,
    /// Angle of its peak round the rope in degrees, rope axes: 0 faces a camera at angle 0.
    #[serde(default)]
    pub angle_deg: Option<f64>,
    /// Highest line score of its alarms.
    pub peak_score: f64,
    /// 1 for the highest peak of its level, and so on; `None` while the inspection runs.
    #[serde(default)]
    pub rank: Option<usize>,
    /// What it is likely to be.
    #[serde(default)]
    pub suggestion: Option<Suggestion>,
    /// Its alarms.
    pub alarms: Vec<AlarmRow>,
}

impl DefectRow {
    /// The alarm with the highest score; of several, the last.
    pub fn worst(&self) -> Option<&AlarmRow> {
        self.alarms.iter().max_by(|a, b| a.peak_score.total_cmp(&b.peak_score))
    }
}

/// A stretch of a view that was not inspected. Not covered is not intact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NotCovered {
    /// The view.
    pub view: usize,
    /// Rope metre where it begins.
    pub from_m: f64,
    /// Rope metre where it ends.
    pub to_m: f64,
    /// Why.
    pub reason: String,
}

/// The threshold that decided, and where it came from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Threshold {
    /// Lines with a score above it are alarms.
    pub line_score: f64,
    /// Lines with a score above it, but not above `line_score`, are worth looking at again; `None`: there is no second level.
    #[serde(default)]
    pub look_again_line_score: Option<f64>,
    /// How it was found, such as `automatic, budget 2 false defects per 100 m, ..`, or who set it.
    pub origin: String,
}

impl Threshold {
    /// A threshold that somebody sets for one inspection.
    pub fn by_hand(line_score: f64) -> Self {
        Self { line_score, look_again_line_score: None, origin: "set by hand for this inspection".into() }
    }
}

/// `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Program version.
    pub ropescope_version: String,
    /// Name of the model that was used, if any.
    pub model: Option<String>,
    /// Construction of the rope.
    pub construction: String,
    /// Number of lines of the longest view.
    pub lines: usize,
    /// Metres of rope in the acquisition.
    pub metres: f64,
    /// Metres times views that were inspected (aligned, if there was no model).
    pub covered_view_m: f64,
    /// Metres times views that were not, with reasons.
    pub not_covered: Vec<NotCovered>,
    /// The threshold; `None` without a model.
    pub threshold: Option<Threshold>,
    /// Number of defects; `None` without a model.
    pub defects: Option<usize>,
    /// Number of places that are no defects but worth looking at again; `None` without a second level.
    #[serde(default)]
    pub look_again: Option<usize>,
    /// Whether the model still fits this rope; `None` without a model that knows. In the file `cannot_tell` stands beside `fits`.
    #[serde(default, serialize_with = "super::third_answer::write")]
    pub fit: Option<ModelFit>,
    /// Diameter, ovality and looseness along the rope; `None` where no diameter was measured.
    #[serde(default)]
    pub diameter: Option<DiameterSummary>,
    /// Wall-clock seconds of the run, without those in which it waited for frames.
    pub seconds: f64,
    /// Metres of rope (all views) per second.
    pub metres_per_second: f64,
    /// What else a person should know, as sentences.
    pub notes: Vec<String>,
}

/// How per-line scores are stored in the results folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LineScoreFormat {
    /// `line_scores.csv` (`view,line,score`).
    #[default]
    Csv,
    /// `line_scores_view{v}.f32`: little-endian f32 a line, NaN where the line was not inspected. Random access for services.
    Binary,
}
