//! Acquisitions: announce, look, delete.

use super::acquisition_body::{Acquisition, NewAcquisition};
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
use serde::Deserialize;
use utoipa::IntoParams;
use uuid::Uuid;

/// Most frames of a view: frame files are numbered with six digits.
pub const MAX_FRAMES: u32 = 1_000_000;

/// Which acquisitions.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct AcquisitionFilter {
    /// Only those of this rope.
    rope_id: Option<Uuid>,
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
    let new = body.row(id, rope.id)?;
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
