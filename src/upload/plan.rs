//! What an upload will bring: the objects to create and the frames to send, read from the folder before anything is sent.

use super::ids::derived;
use crate::pipeline::acquisition::{self, AcquisitionError, RopeFile};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use uuid::Uuid;

/// Name of the ropeway when neither `rope.json` nor the person gives one.
const UNNAMED_ROPEWAY: &str = "unnamed ropeway";

/// Names that take precedence over those in `rope.json`.
#[derive(Debug, Clone, Default)]
pub struct Names {
    /// The ropeway.
    pub ropeway: Option<String>,
    /// The rope.
    pub rope: Option<String>,
}

/// Why a folder cannot be uploaded.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The folder is no acquisition.
    #[error(transparent)]
    Acquisition(#[from] AcquisitionError),
    /// A frame could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The frame.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
}

/// A frame file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedFrame {
    /// Where it lies.
    pub path: PathBuf,
    /// Its length.
    pub bytes: u64,
}

/// Everything that an upload creates and sends.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Name of the ropeway.
    pub ropeway: String,
    /// Name of the rope.
    pub rope: String,
    /// Construction and diameters, as the API takes them.
    pub design: Value,
    /// All of the acquisition but its rope, as the API takes it.
    acquisition: Value,
    /// Distinguishes this acquisition from every other of the same rope.
    fingerprint: Vec<u8>,
    /// `frames[view][frame]`.
    pub frames: Vec<Vec<PlannedFrame>>,
}

impl Plan {
    /// Reads `folder`: `rope.json`, the sizes of all frames, and the first and last frame of every view for the fingerprint
    /// (sensor noise makes any two frames differ, and hashing terabytes before the first byte is sent helps nobody).
    pub fn read(folder: &Path, names: &Names) -> Result<Self, PlanError> {
        let file = RopeFile::read(folder)?;
        file.validate()?;
        let mut frames = Vec::new();
        for paths in acquisition::frame_paths(folder, &file)? {
            frames.push(paths.into_iter().map(planned).collect::<Result<Vec<_>, _>>()?);
        }
        let folder_name =
            folder.canonicalize().ok().and_then(|f| f.file_name().map(|n| n.to_string_lossy().into_owned()));
        let views: Vec<Value> = file
            .views
            .iter()
            .zip(&frames)
            .map(|(view, frames)| json!({"angle_deg": view.angle_deg, "frames": frames.len()}))
            .collect();
        let acquisition = without_nulls(json!({
            "line_pitch_mm": file.line_pitch_mm,
            "sensor_px": file.sensor_px,
            "rope_width_px": file.rope_width_px,
            "views": views,
            "start_m": file.start_m,
            "acquired_at": file.acquired_at,
        }));
        Ok(Self {
            ropeway: names.ropeway.clone().or(file.ropeway).unwrap_or_else(|| UNNAMED_ROPEWAY.into()),
            rope: names.rope.clone().or(file.rope).or(folder_name).unwrap_or_else(|| "unnamed rope".into()),
            design: without_nulls(json!({
                "strands": file.strands,
                "wires_per_strand": file.wires_per_strand,
                "rope_diameter_mm": file.rope_diameter_mm,
                "strand_lay_mm": file.strand_lay_mm,
                "wire_lay_mm": file.wire_lay_mm,
                "strand_diameter_mm": file.strand_diameter_mm,
                "wire_diameter_mm": file.wire_diameter_mm,
            })),
            fingerprint: fingerprint(&acquisition, &frames)?,
            acquisition,
            frames,
        })
    }

    /// Id of the ropeway, unless the service already has one of this name.
    pub fn ropeway_id(&self) -> Uuid {
        derived("ropeway", &[self.ropeway.as_bytes()])
    }

    /// Id of the rope on a ropeway, unless that already has one of this name.
    pub fn rope_id(&self, ropeway_id: Uuid) -> Uuid {
        derived("rope", &[ropeway_id.as_bytes(), self.rope.as_bytes()])
    }

    /// Id of the acquisition of a rope.
    pub fn acquisition_id(&self, rope_id: Uuid) -> Uuid {
        derived("acquisition", &[rope_id.as_bytes(), &self.fingerprint])
    }

    /// The acquisition as the API takes it.
    pub fn acquisition(&self, rope_id: Uuid) -> Value {
        let mut body = self.acquisition.clone();
        body["rope_id"] = json!(rope_id);
        body
    }

    /// The body that completes the acquisition.
    pub fn completion(&self) -> Value {
        json!({"views": self.frames.iter().map(|f| json!({"frames": f.len()})).collect::<Vec<_>>()})
    }

    /// Number of frames over all views.
    pub fn frame_count(&self) -> usize {
        self.frames.iter().map(Vec::len).sum()
    }

    /// Bytes of all frames.
    pub fn bytes(&self) -> u64 {
        self.frames.iter().flatten().map(|f| f.bytes).sum()
    }
}

fn planned(path: PathBuf) -> Result<PlannedFrame, PlanError> {
    let bytes = std::fs::metadata(&path).map_err(|source| PlanError::Read { path: path.clone(), source })?.len();
    Ok(PlannedFrame { path, bytes })
}

fn fingerprint(acquisition: &Value, frames: &[Vec<PlannedFrame>]) -> Result<Vec<u8>, PlanError> {
    let mut hash = Sha256::new();
    hash.update(acquisition.to_string()); // object keys are sorted
    for view in frames {
        for frame in view {
            hash.update(frame.bytes.to_be_bytes());
        }
        for frame in view.first().into_iter().chain(view.last()) {
            let content =
                std::fs::read(&frame.path).map_err(|source| PlanError::Read { path: frame.path.clone(), source })?;
            hash.update(Sha256::digest(content));
        }
    }
    Ok(hash.finalize().to_vec())
}

/// Drops absent values, so that a service sees what the person wrote and nothing more.
fn without_nulls(value: Value) -> Value {
    match value {
        Value::Object(map) => Value::Object(map.into_iter().filter(|(_, v)| !v.is_null()).collect()),
        other => other,
    }
}
