//! What an upload will bring: the objects to create and the frames to send, read from the folder before anything is sent.

use super::ids::derived;
use super::packing::EXTENSIONS;
use crate::pipeline::acquisition::{self, AcquisitionError, RopeFile};
use crate::pipeline::preview::LEAST_SENSOR_PX;
use crate::store::digest::hex;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;
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
    /// A file is no frame.
    #[error("{path} cannot be sent: {reason}")]
    Frame {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Too few columns for previews.
    #[error(
        "frames of {sensor_px} columns have no previews, only those of {LEAST_SENSOR_PX} or more: run it without --preview-first"
    )]
    TooNarrow {
        /// Columns of the frames.
        sensor_px: u32,
    },
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
    /// When it was last changed, ms since 1970.
    pub modified_ms: u64,
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
    /// The folder it was read from.
    pub folder: PathBuf,
    /// Columns of every frame.
    pub sensor_px: u32,
    /// False while frames may still be added.
    pub whole: bool,
    /// `frames[view][frame]`.
    pub frames: Vec<Vec<PlannedFrame>>,
}

impl Plan {
    /// Reads a whole recording: `rope.json` and the sizes of all frames. Errors: a view without frames, a gap.
    pub fn read(folder: &Path, names: &Names) -> Result<Self, PlanError> {
        let file = RopeFile::read(folder)?;
        let views = file.views.iter().map(|view| acquisition::view_frames(&folder.join(&view.folder), &EXTENSIONS));
        let paths = views.collect::<Result<_, _>>()?;
        Self::of(folder, names, file, paths, true)
    }

    /// Reads a recording that still grows: frames without gap from the first one on, of some views perhaps none yet.
    pub fn read_growing(folder: &Path, names: &Names) -> Result<Self, PlanError> {
        let file = RopeFile::read(folder)?;
        let mut views = Vec::new();
        for view in &file.views {
            let folder = folder.join(&view.folder);
            let numbered =
                if folder.is_dir() { acquisition::numbered_frames(&folder, &EXTENSIONS)? } else { BTreeMap::new() };
            let gapless = numbered.into_iter().enumerate().take_while(|(expected, (number, _))| expected == number);
            views.push(gapless.map(|(_, (_, path))| path).collect());
        }
        Self::of(folder, names, file, views, false)
    }

    fn of(
        folder: &Path,
        names: &Names,
        file: RopeFile,
        paths: Vec<Vec<PathBuf>>,
        whole: bool,
    ) -> Result<Self, PlanError> {
        file.validate()?;
        let mut frames = Vec::new();
        for paths in paths {
            frames.push(paths.into_iter().map(planned).collect::<Result<Vec<_>, _>>()?);
        }
        let folder_name =
            folder.canonicalize().ok().and_then(|f| f.file_name().map(|n| n.to_string_lossy().into_owned()));
        let views: Vec<Value> = file
            .views
            .iter()
            .zip(&frames)
            .map(|(view, frames)| {
                without_nulls(json!({
                    "angle_deg": view.angle_deg, "px_per_mm": view.px_per_mm, "frames": whole.then_some(frames.len()),
                }))
            })
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
            folder: folder.into(),
            sensor_px: file.sensor_px,
            whole,
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

    /// Distinguishes this recording from every other, also while it grows: what `rope.json` says and the first frame of every
    /// view, lower-case hex. Sensor noise makes any two frames differ. `None` until every view has its first frame.
    pub fn begin(&self) -> Result<Option<String>, PlanError> {
        let mut hash = Sha256::new();
        let mut acquisition = self.acquisition.clone();
        for view in acquisition["views"].as_array_mut().into_iter().flatten() {
            view["frames"] = Value::Null; // unknown while it grows
        }
        hash.update(acquisition.to_string()); // object keys are sorted
        for view in &self.frames {
            let Some(frame) = view.first() else { return Ok(None) };
            hash.update(content_digest(frame)?);
        }
        Ok(Some(hex(&hash.finalize())))
    }

    /// Id of the acquisition of a rope, for a recording that was not begun before: from its beginning, and, when it is whole,
    /// from the sizes of all frames and the last one of every view (hashing terabytes before the first byte is sent helps nobody).
    pub fn acquisition_id(&self, rope_id: Uuid, begin: &str) -> Result<Uuid, PlanError> {
        let mut hash = Sha256::new();
        hash.update(begin);
        if self.whole {
            for frame in self.frames.iter().flatten() {
                hash.update(frame.bytes.to_be_bytes());
            }
            for frame in self.frames.iter().filter_map(|view| view.last()) {
                hash.update(content_digest(frame)?);
            }
        }
        Ok(derived("acquisition", &[rope_id.as_bytes(), &hash.finalize()]))
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
    let known = std::fs::metadata(&path).and_then(|m| Ok((m.len(), m.modified()?)));
    let (bytes, modified) = known.map_err(|source| PlanError::Read { path: path.clone(), source })?;
    let modified_ms = modified.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64);
    Ok(PlannedFrame { path, bytes, modified_ms })
}

fn content_digest(frame: &PlannedFrame) -> Result<[u8; 32], PlanError> {
    let content = std::fs::read(&frame.path).map_err(|source| PlanError::Read { path: frame.path.clone(), source })?;
    Ok(Sha256::digest(content).into())
}

/// Drops absent values, so that a service sees what the person wrote and nothing more.
fn without_nulls(value: Value) -> Value {
    match value {
        Value::Object(map) => Value::Object(map.into_iter().filter(|(_, v)| !v.is_null()).collect()),
        other => other,
    }
}
