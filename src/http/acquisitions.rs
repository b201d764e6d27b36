//! Acquisitions: announce, look, delete.

use super::extract::{Json, Path, Query};
use super::pages::{PageQuery, page_of};
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{choose_id, created};
use super::{Problem, times};
use crate::app::App;
use crate::pipeline::acquisition::AcquisitionError;
use crate::store::acquisitions::{self, Deletion};
use crate::store::{Id, ropes};
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Most frames of a view: frame files are numbered with six digits.
pub const MAX_FRAMES: u32 = 1_000_000;

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
    id: Option<Uuid>,
    /// The rope it shows.
    rope_id: Uuid,
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

/// Which acquisitions.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct AcquisitionFilter {
    /// Only those of this rope.
    rope_id: Option<Uuid>,
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

page_of!(
    /// A page of acquisitions.
    AcquisitionPage, Acquisition, acquisitions::Acquisition
);

/// Refuses an acquisition that this rope cannot have.
pub fn check(rope: &ropes::Rope, new: &acquisitions::NewAcquisition) -> Result<(), Problem> {
    match new.rope_file(&rope.design).validate() {
        Ok(_) => {}
        Err(AcquisitionError::OutOfRange { quantity, value, min, max }) => {
            return Err(Problem::outside(quantity, value, min, max));
        }
        Err(error) => return Err(Problem::out_of_range(error.to_string())),
    }
    for view in &new.views {
        check_frames(view.frames)?;
    }
    Ok(())
}

pub(super) fn check_frames(frames: Option<u32>) -> Result<(), Problem> {
    match frames {
        Some(frames) if !(1..=MAX_FRAMES).contains(&frames) => {
            Err(Problem::outside("frames", f64::from(frames), 1.0, f64::from(MAX_FRAMES)))
        }
        _ => Ok(()),
    }
}

async fn create(app: &App, id: Option<Uuid>, body: NewAcquisition) -> Result<Response, Problem> {
    let id = choose_id(app, id, body.id)?;
    let Some(rope) = app.store.rope(Id(body.rope_id)).await? else {
        return Err(Problem::unknown_reference(format!("there is no rope {}", body.rope_id))
            .with("field", "rope_id")
            .with("value", body.rope_id));
    };
    let acquired_at_ms = body.acquired_at.as_deref().map(|text| times::parse("acquired_at", text)).transpose()?;
    let new = acquisitions::NewAcquisition {
        id,
        rope_id: rope.id,
        line_pitch_mm: body.line_pitch_mm,
        sensor_px: body.sensor_px,
        rope_width_px: body.rope_width_px,
        start_m: body.start_m.unwrap_or(0.0),
        acquired_at_ms,
        views: body
            .views
            .iter()
            .map(|v| acquisitions::NewView { angle_deg: v.angle_deg, px_per_mm: v.px_per_mm, frames: v.frames })
            .collect(),
    };
    check(&rope, &new)?;
    let outcome = app.store.create_acquisition(&new, app.now_ms()).await?;
    created(outcome, format!("/api/v1/acquisitions/{id}"), |a| Ok(Acquisition::from(a)))
}

/// Create an acquisition
#[utoipa::path(post, path = "/acquisitions", tag = "acquisitions", request_body = NewAcquisition, responses(
    (status = 201, description = "It was created", body = Acquisition, headers(("location" = String, description = "Its address"))),
    (status = 200, description = "It was there with the same content", body = Acquisition),
    WriteProblems))]
pub async fn create_acquisition(State(app): State<App>, Json(body): Json<NewAcquisition>) -> Result<Response, Problem> {
    create(&app, None, body).await
}

/// Create an acquisition under an id of the client's choice
///
/// The same again is the same acquisition. It may say how many frames a view has where nobody has said so yet.
#[utoipa::path(put, path = "/acquisitions/{id}", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")), request_body = NewAcquisition, responses(
    (status = 201, description = "It was created", body = Acquisition, headers(("location" = String, description = "Its address"))),
    (status = 200, description = "It was there with the same content", body = Acquisition),
    WriteProblems))]
pub async fn put_acquisition(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<NewAcquisition>,
) -> Result<Response, Problem> {
    create(&app, Some(id), body).await
}

/// An acquisition
#[utoipa::path(get, path = "/acquisitions/{id}", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")),
    responses((status = 200, description = "The acquisition", body = Acquisition), ReadProblems))]
pub async fn get_acquisition(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Acquisition>, Problem> {
    Ok(axum::Json(load(&app, id).await?.into()))
}

/// The acquisition of a path.
pub async fn load(app: &App, id: Uuid) -> Result<acquisitions::Acquisition, Problem> {
    app.store.acquisition(Id(id)).await?.ok_or_else(|| Problem::no("acquisition", id))
}

/// The acquisition of a path, if it still has its frames. Errors: 410 when retention removed them.
pub async fn load_with_frames(app: &App, id: Uuid) -> Result<acquisitions::Acquisition, Problem> {
    let acquisition = load(app, id).await?;
    match acquisition.row.frames_removed_at_ms {
        None => Ok(acquisition),
        Some(ms) => Err(Problem::frames_removed(format!(
            "the frames of acquisition {id} were removed on {}, after the time that its ropeway keeps them; results stay",
            times::rfc3339(ms)
        ))),
    }
}

/// Acquisitions, newest first
#[utoipa::path(get, path = "/acquisitions", tag = "acquisitions", params(AcquisitionFilter, PageQuery),
    responses((status = 200, description = "A page of acquisitions", body = AcquisitionPage), ReadProblems))]
pub async fn list_acquisitions(
    State(app): State<App>,
    Query(filter): Query<AcquisitionFilter>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<AcquisitionPage>, Problem> {
    Ok(axum::Json(app.store.acquisitions(filter.rope_id.map(Id), page.request()?).await?.try_into()?))
}

/// Delete an acquisition and its frames; refused while jobs refer to it
#[utoipa::path(delete, path = "/acquisitions/{id}", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")),
    responses((status = 204, description = "It is gone"), WriteProblems))]
pub async fn delete_acquisition(State(app): State<App>, Path(id): Path<Uuid>) -> Result<StatusCode, Problem> {
    match app.store.delete_acquisition(Id(id)).await? {
        Deletion::Deleted => Ok(StatusCode::NO_CONTENT),
        Deletion::Unknown => Err(Problem::no("acquisition", id)),
        Deletion::InUse { jobs } => {
            Err(Problem::acquisition_in_use(format!("{jobs} jobs refer to acquisition {id}; nothing was changed"))
                .with("value", jobs))
        }
    }
}
