//! An acquisition folder: `rope.json` and the frames beside it (design: `rope.json` as read is [`RopeFile`], checked is [`Acquisition`]).

use super::source::{FrameFiles, MAX_SENSOR_PX};
use crate::vision::aligner::AlignerSpec;
use crate::vision::rope::{Rope, RopeDesign, RopeDesignError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Most views of an acquisition.
pub const MAX_VIEWS: usize = 8;

/// `rope.json` as somebody wrote it. Unknown keys are ignored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RopeFile {
    /// Number of strands.
    pub strands: usize,
    /// Number of outer wires per strand.
    pub wires_per_strand: usize,
    /// Rope diameter in mm.
    pub rope_diameter_mm: f64,
    /// Nominal strand lay in mm, signed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strand_lay_mm: Option<f64>,
    /// Nominal wire lay in mm, signed, against the fixed axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wire_lay_mm: Option<f64>,
    /// Strand diameter in mm, if the maker states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strand_diameter_mm: Option<f64>,
    /// Wire diameter in mm, if the maker states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wire_diameter_mm: Option<f64>,
    /// Rope per camera line in mm.
    pub line_pitch_mm: f64,
    /// Width of the rope in the image in pixels: a hint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rope_width_px: Option<f64>,
    /// Pixels of a camera line.
    pub sensor_px: u32,
    /// The views, in order.
    pub views: Vec<ViewFile>,
    /// Rope metre of the first line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_m: Option<f64>,
    /// Name of the ropeway.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ropeway: Option<String>,
    /// Name of the rope.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rope: Option<String>,
    /// When it was acquired, RFC 3339.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acquired_at: Option<String>,
}

/// One view in `rope.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewFile {
    /// Folder of its frames, beside `rope.json`.
    pub folder: String,
    /// The camera stands where strands of this phase are nearest, in degrees.
    pub angle_deg: f64,
    /// Pixels per mm at the distance of the rope axis, if somebody measured it. All views state it, or none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub px_per_mm: Option<f64>,
}

/// Why a folder or a `rope.json` is no acquisition.
#[derive(Debug, thiserror::Error)]
pub enum AcquisitionError {
    /// A file could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The file is not the JSON that is expected.
    #[error("{path} is not a valid rope.json: {reason}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What the parser said, such as a missing field.
        reason: String,
    },
    /// The rope cannot exist.
    #[error("the rope design is not possible: {0}")]
    Design(#[from] RopeDesignError),
    /// A quantity lies outside its interval.
    #[error("{quantity} is {value}, but must lie between {min} and {max}")]
    OutOfRange {
        /// Its name in `rope.json`.
        quantity: &'static str,
        /// The value.
        value: f64,
        /// The least.
        min: f64,
        /// The most.
        max: f64,
    },
    /// Some views state their scale, others do not.
    #[error("px_per_mm is given for {of} of {views} views: give it for all of them or for none")]
    PartlyCalibrated {
        /// Views with a scale.
        of: usize,
        /// All views.
        views: usize,
    },
    /// A view folder leaves the acquisition folder.
    #[error("view folder {folder:?} is not a plain folder name")]
    ViewFolder {
        /// The name.
        folder: String,
    },
    /// A view has no frames.
    #[error("{path} has no frames (frame_000000.png, ...)")]
    NoFrames {
        /// The folder of the view.
        path: PathBuf,
    },
    /// The numbering of the frames has a gap.
    #[error("{path} is missing, but later frames exist: the acquisition is incomplete")]
    MissingFrame {
        /// The first frame that is not there.
        path: PathBuf,
    },
}

/// A checked acquisition: what the pipeline needs to know besides the pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Acquisition {
    /// The rope.
    pub rope: Rope,
    /// Rope per camera line in mm.
    pub line_pitch_mm: f64,
    /// Columns of every frame.
    pub sensor_px: u32,
    /// Expected width of the rope in the image in pixels, if known.
    pub rope_width_px: Option<f64>,
    /// Angle of each view in rad, in order of the views.
    pub view_angles_rad: Vec<f64>,
    /// Calibrated scale of each view in pixels per mm at the distance of the rope axis; empty if nobody measured it.
    pub px_per_mm: Vec<f64>,
    /// Rope metre of line 0.
    pub start_m: f64,
    /// Lines and columns of the camera that were made one: 1, unless these are previews.
    pub reduction: u32,
}

impl RopeFile {
    /// Reads `DIR/rope.json`.
    pub fn read(folder: &Path) -> Result<Self, AcquisitionError> {
        let path = folder.join("rope.json");
        let text =
            std::fs::read_to_string(&path).map_err(|source| AcquisitionError::Read { path: path.clone(), source })?;
        serde_json::from_str(&text).map_err(|e| AcquisitionError::Json { path, reason: e.to_string() })
    }

    /// Checks every value. Errors: the first quantity that is out of range, or all that is wrong with the design.
    pub fn validate(&self) -> Result<Acquisition, AcquisitionError> {
        let rope = RopeDesign {
            strands: self.strands,
            wires_per_strand: self.wires_per_strand,
            diameter_mm: self.rope_diameter_mm,
            strand_lay_mm: self.strand_lay_mm,
            wire_lay_mm: self.wire_lay_mm,
            strand_diameter_mm: self.strand_diameter_mm,
            wire_diameter_mm: self.wire_diameter_mm,
        }
        .validate()?;
        let check = |quantity, value: f64, min, max| {
            if value >= min && value <= max {
                Ok(())
            } else {
                Err(AcquisitionError::OutOfRange { quantity, value, min, max })
            }
        };
        check("line_pitch_mm", self.line_pitch_mm, 0.005, 2.0)?;
        check("sensor_px", f64::from(self.sensor_px), 64.0, f64::from(MAX_SENSOR_PX))?;
        check("number of views", self.views.len() as f64, 1.0, MAX_VIEWS as f64)?;
        if let Some(width_px) = self.rope_width_px {
            check("rope_width_px", width_px, 16.0, f64::from(self.sensor_px))?;
        }
        check("start_m", self.start_m.unwrap_or(0.0), -1e6, 1e6)?;
        for view in &self.views {
            check("angle_deg", view.angle_deg, -360.0, 360.0)?;
            let plain = !view.folder.is_empty()
                && view.folder != "."
                && view.folder != ".."
                && !view.folder.contains(['/', '\\', '\0']);
            if !plain {
                return Err(AcquisitionError::ViewFolder { folder: view.folder.clone() });
            }
        }
        let px_per_mm: Vec<f64> = self.views.iter().filter_map(|view| view.px_per_mm).collect();
        for &px_per_mm in &px_per_mm {
            // The rope must be as wide in the image as `rope_width_px` may be.
            let mm = rope.diameter_mm();
            check("px_per_mm", px_per_mm, 16.0 / mm, f64::from(self.sensor_px) / mm)?;
        }
        // Diameters of some views by one measure and of others by another could not be compared.
        if !px_per_mm.is_empty() && px_per_mm.len() < self.views.len() {
            return Err(AcquisitionError::PartlyCalibrated { of: px_per_mm.len(), views: self.views.len() });
        }
        Ok(Acquisition {
            rope,
            line_pitch_mm: self.line_pitch_mm,
            sensor_px: self.sensor_px,
            rope_width_px: self.rope_width_px,
            view_angles_rad: self.views.iter().map(|v| v.angle_deg.to_radians()).collect(),
            px_per_mm,
            start_m: self.start_m.unwrap_or(0.0),
            reduction: 1,
        })
    }
}

/// Endings of frame files that the pipeline reads.
const EXTENSIONS: [&str; 3] = ["png", "tif", "tiff"];

/// The frames of a folder in order, `frame_000000.png` and so on. Errors: a view without frames, a gap in the numbers.
pub fn frame_paths(folder: &Path, file: &RopeFile) -> Result<Vec<Vec<PathBuf>>, AcquisitionError> {
    file.views.iter().map(|view| view_frames(&folder.join(&view.folder), &EXTENSIONS)).collect()
}

/// The frames of one view by number, as far as they are there.
pub fn numbered_frames(folder: &Path, extensions: &[&str]) -> Result<BTreeMap<usize, PathBuf>, AcquisitionError> {
    let read = |source| AcquisitionError::Read { path: folder.into(), source };
    let mut numbered = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        let path = entry.map_err(read)?.path();
        let number = path
            .file_stem()
            .and_then(|s| s.to_str())
            .and_then(|s| s.strip_prefix("frame_"))
            .and_then(|s| s.parse::<usize>().ok());
        let image = path.extension().and_then(|e| e.to_str()).is_some_and(|e| extensions.contains(&e));
        if let (Some(number), true) = (number, image) {
            numbered.insert(number, path);
        }
    }
    Ok(numbered)
}

/// The frames of one view in order. Errors: none, or a gap in the numbers.
pub fn view_frames(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>, AcquisitionError> {
    let numbered = numbered_frames(folder, extensions)?;
    if numbered.is_empty() {
        return Err(AcquisitionError::NoFrames { path: folder.into() });
    }
    for (expected, number) in numbered.keys().enumerate() {
        if *number != expected {
            return Err(AcquisitionError::MissingFrame { path: folder.join(format!("frame_{expected:06}.png")) });
        }
    }
    Ok(numbered.into_values().collect())
}

/// Opens a folder: the checked acquisition and its frames.
pub fn open_folder(folder: &Path) -> Result<(Acquisition, FrameFiles), AcquisitionError> {
    let file = RopeFile::read(folder)?;
    let acquisition = file.validate()?;
    let frames = FrameFiles::new(acquisition.sensor_px, frame_paths(folder, &file)?);
    Ok((acquisition, frames))
}

impl Acquisition {
    /// Rope metre of a line.
    pub fn position_m(&self, line: usize) -> f64 {
        self.start_m + line as f64 * self.line_pitch_mm / 1000.0
    }

    /// Whether somebody measured the scale of the cameras, so that diameters are absolute.
    pub fn is_calibrated(&self) -> bool {
        !self.px_per_mm.is_empty()
    }

    /// What the aligner must know of it.
    pub fn aligner_spec(&self) -> AlignerSpec {
        let spec = AlignerSpec::new(
            self.rope.clone(),
            self.line_pitch_mm,
            self.view_angles_rad.clone(),
            self.sensor_px as usize,
            self.rope_width_px,
        );
        AlignerSpec { calibrated_px_per_mm: self.px_per_mm.clone(), ..spec }
    }

    /// The construction in one line, as models and errors name it: `6x9, 32 mm, 4 views`.
    pub fn construction(&self) -> String {
        format!(
            "{}x{}, {} mm, {} views",
            self.rope.strands(),
            self.rope.wires(),
            self.rope.diameter_mm(),
            self.view_angles_rad.len()
        )
    }
}
