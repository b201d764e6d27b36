//! What is said of an acquisition: by its client when it is created, and by the service.

use super::{Problem, times};
use crate::store::Id;
use crate::store::acquisitions;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Which way the camera head went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Rope metres grow with the line number. The only one so far: lines of a pass the other way are sent in reverse order.
    Forward,
}

/// A view of an acquisition.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct View {
    /// Number, from 0.
    view: u32,
    /// The camera stands where strands of this phase are nearest, in degrees.
    angle_deg: f64,
    /// Calibrated scale in px/mm at the distance of the rope axis; null: diameters are relative to the nominal one.
    #[schema(required)]
    px_per_mm: Option<f64>,
    /// How many frames were announced; null until somebody says.
    #[schema(required)]
    frames: Option<u32>,
    /// How many frames are there.
    frames_present: u32,
}

/// One pass of the camera head along a rope.
#[derive(Debug, Serialize, ToSchema)]
pub struct Acquisition {
    /// Id.
    id: Uuid,
    /// The rope it shows.
    rope_id: Uuid,
    /// Rope per camera line in mm.
    line_pitch_mm: f64,
    /// Columns of every frame.
    sensor_px: u32,
    /// Width of the rope in the image in px, a hint.
    #[schema(required)]
    rope_width_px: Option<f64>,
    /// Its views.
    views: Vec<View>,
    /// Rope metre of line 0.
    start_m: f64,
    /// Which way the camera head went.
    direction: Direction,
    /// When the pass began.
    #[schema(required, format = DateTime)]
    acquired_at: Option<String>,
    /// `open` while frames are taken, then `complete`.
    state: AcquisitionState,
    /// How many frames are there.
    frames_present: u64,
    /// How many were announced; null until all views say so.
    #[schema(required)]
    frames_expected: Option<u64>,
    /// Bytes of the frames that are there.
    frame_bytes: i64,
    /// When its frames were removed, because their time was over; null while they are there.
    #[schema(required, format = DateTime)]
    frames_removed_at: Option<String>,
    /// When it was created.
    #[schema(format = DateTime)]
    created_at: String,
}

/// State of an acquisition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum AcquisitionState {
    /// Frames are taken.
    Open,
    /// All frames are there.
    Complete,
}

/// A view to be created.
#[derive(Debug, Clone, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewView {
    /// The camera stands where strands of this phase are nearest, in degrees.
    #[schema(minimum = -360, maximum = 360)]
    angle_deg: f64,
    /// Calibrated scale in px/mm at the distance of the rope axis, for absolute diameters: for all views or for none. The rope must be
    /// at least 16 px wide by it, and at most as wide as the sensor.
    #[schema(exclusive_minimum = 0)]
    px_per_mm: Option<f64>,
    /// How many frames will come; may be said at completion instead.
    #[schema(minimum = 1, maximum = 1000000)]
    frames: Option<u32>,
}

/// An acquisition to be created.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewAcquisition {
    /// Id, if the client chooses it.
    pub(super) id: Option<Uuid>,
    /// The rope it shows.
    pub(super) rope_id: Uuid,
    /// Rope per camera line in mm.
    #[schema(minimum = 0.005, maximum = 2.0, example = 0.1)]
    line_pitch_mm: f64,
    /// Columns of every frame.
    #[schema(minimum = 64, maximum = 16384, example = 480)]
    sensor_px: u32,
    /// Width of the rope in the image in px, a hint.
    #[schema(minimum = 16, maximum = 16384)]
    rope_width_px: Option<f64>,
    /// Its views.
    #[schema(min_items = 1, max_items = 8)]
    views: Vec<NewView>,
    /// Rope metre of line 0, else 0.
    #[schema(minimum = -1000000, maximum = 1000000)]
    start_m: Option<f64>,
    /// Which way the camera head went.
    #[expect(dead_code, reason = "checked by reading it: there is one direction so far")]
    direction: Option<Direction>,
    /// When the pass began.
    #[schema(format = DateTime)]
    acquired_at: Option<String>,
}

impl From<acquisitions::Acquisition> for Acquisition {
    fn from(a: acquisitions::Acquisition) -> Self {
        let state = if a.complete() { AcquisitionState::Complete } else { AcquisitionState::Open };
        Self {
            id: a.row.id.0,
            rope_id: a.row.rope_id.0,
            line_pitch_mm: a.row.line_pitch_mm,
            sensor_px: a.row.sensor_px,
            rope_width_px: a.row.rope_width_px,
            frames_present: a.views.iter().map(|v| u64::from(v.frames_present)).sum(),
            frames_expected: a.views.iter().map(|v| v.frames_expected.map(u64::from)).sum(),
            views: a
                .views
                .into_iter()
                .map(|v| View {
                    view: v.view,
                    angle_deg: v.angle_deg,
                    px_per_mm: v.px_per_mm,
                    frames: v.frames_expected,
                    frames_present: v.frames_present,
                })
                .collect(),
            frame_bytes: a.row.frame_bytes,
            frames_removed_at: a.row.frames_removed_at_ms.map(times::rfc3339),
            start_m: a.row.start_m,
            direction: Direction::Forward,
            acquired_at: a.row.acquired_at_ms.map(times::rfc3339),
            state,
            created_at: times::rfc3339(a.row.created_at_ms),
        }
    }
}

impl NewAcquisition {
    /// What is stored of it.
    pub(super) fn row(&self, id: Id, rope: Id) -> Result<acquisitions::NewAcquisition, Problem> {
        let acquired_at_ms = self.acquired_at.as_deref().map(|text| times::parse("acquired_at", text)).transpose()?;
        let view =
            |v: &NewView| acquisitions::NewView { angle_deg: v.angle_deg, px_per_mm: v.px_per_mm, frames: v.frames };
        Ok(acquisitions::NewAcquisition {
            id,
            rope_id: rope,
            line_pitch_mm: self.line_pitch_mm,
            sensor_px: self.sensor_px,
            rope_width_px: self.rope_width_px,
            start_m: self.start_m.unwrap_or(0.0),
            acquired_at_ms,
            views: self.views.iter().map(view).collect(),
        })
    }
}
