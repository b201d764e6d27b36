//! Ropeways.

use super::extract::{Json, Path, Query};
use super::pages::{PageQuery, page_of};
use super::problem::{ReadProblems, WriteProblems};
use super::{Problem, times};
use crate::app::App;
use crate::store::{Created, Id, ropeways};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Longest name that is taken, in bytes.
pub const MAX_NAME: usize = 200;

/// An installation.
#[derive(Debug, Serialize, ToSchema)]
pub struct Ropeway {
    /// Id.
    id: Uuid,
    /// What people call it.
    name: String,
    /// Where it stands.
    #[schema(required)]
    location: Option<String>,
    /// Most bytes of frames of all its ropes; null: as the disk allows.
    #[schema(required)]
    quota_bytes: Option<i64>,
    /// Days after which frames may be removed; null: never.
    #[schema(required)]
    keep_days: Option<u32>,
    /// When it was created.
    #[schema(format = DateTime)]
    created_at: String,
}

impl From<ropeways::Ropeway> for Ropeway {
    fn from(row: ropeways::Ropeway) -> Self {
        Self {
            id: row.id.0,
            name: row.name,
            location: row.location,
            quota_bytes: row.quota_bytes,
            keep_days: row.keep_days,
            created_at: times::rfc3339(row.created_at_ms),
        }
    }
}

page_of!(
    /// A page of ropeways.
    RopewayPage, Ropeway, ropeways::Ropeway
);

/// A ropeway to be created.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewRopeway {
    /// Id, if the client chooses it (not with PUT: there the path says it).
    id: Option<Uuid>,
    /// What people call it.
    #[schema(min_length = 1, max_length = 200)]
    name: String,
    /// Where it stands.
    #[schema(max_length = 200)]
    location: Option<String>,
}

/// Refuses empty and endless texts. Lengths are counted in characters, as the contract counts them.
pub fn check_text(field: &str, text: &str, min: usize, max: usize) -> Result<(), Problem> {
    let length = text.chars().count();
    if (min..=max).contains(&length) && !text.contains('\0') {
        return Ok(());
    }
    if text.contains('\0') {
        return Err(Problem::out_of_range(format!("{field} contains a null character")).with("field", field));
    }
    Err(Problem::out_of_range(format!("{field} has {length} characters, but must have {min} to {max}"))
        .with("field", field)
        .limit(length, serde_json::json!({ "min": min, "max": max })))
}

/// Settles on the id of something that is created: the one of the path, else of the body, else a new one.
pub fn choose_id(app: &App, path: Option<Uuid>, body: Option<Uuid>) -> Result<Id, Problem> {
    match (path, body) {
        (Some(path), Some(body)) if path != body => {
            Err(Problem::out_of_range(format!("the path says {path}, but the body says {body}"))
                .with("field", "id")
                .limit(body, path))
        }
        (Some(id), _) | (None, Some(id)) => Ok(Id(id)),
        (None, None) => Ok(app.new_id()),
    }
}

/// 201 for what is new, 200 for what was there with the same content, 409 for other content; with its address.
pub fn created<T, V: Serialize>(
    outcome: Created<T>,
    address: String,
    view: impl Fn(T) -> Result<V, Problem>,
) -> Result<Response, Problem> {
    let (status, row) = match outcome {
        Created::New(row) => (StatusCode::CREATED, row),
        Created::Same(row) => (StatusCode::OK, row),
        Created::Different => {
            return Err(Problem::id_in_use(format!("{address} exists with other content; nothing was changed")));
        }
    };
    Ok((status, [(header::LOCATION, address)], axum::Json(view(row)?)).into_response())
}

async fn create(app: &App, id: Option<Uuid>, body: NewRopeway) -> Result<Response, Problem> {
    check_text("name", &body.name, 1, MAX_NAME)?;
    if let Some(location) = &body.location {
        check_text("location", location, 0, MAX_NAME)?;
    }
    let id = choose_id(app, id, body.id)?;
    let outcome = app.store.create_ropeway(id, &body.name, body.location.as_deref(), app.now_ms()).await?;
    created(outcome, format!("/api/v1/ropeways/{id}"), |row| Ok(Ropeway::from(row)))
}

/// Create a ropeway
#[utoipa::path(post, path = "/ropeways", tag = "ropes", request_body = NewRopeway, responses(
    (status = 201, description = "It was created", body = Ropeway, headers(("location" = String, description = "Its address"))),
    (status = 200, description = "It was there with the same content", body = Ropeway),
    WriteProblems))]
pub async fn create_ropeway(State(app): State<App>, Json(body): Json<NewRopeway>) -> Result<Response, Problem> {
    create(&app, None, body).await
}

/// Create a ropeway under an id of the client's choice
#[utoipa::path(put, path = "/ropeways/{id}", tag = "ropes", params(("id" = Uuid, Path, description = "The ropeway")),
    request_body = NewRopeway, responses(
    (status = 201, description = "It was created", body = Ropeway, headers(("location" = String, description = "Its address"))),
    (status = 200, description = "It was there with the same content", body = Ropeway),
    WriteProblems))]
pub async fn put_ropeway(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<NewRopeway>,
) -> Result<Response, Problem> {
    create(&app, Some(id), body).await
}

/// How many frames of a ropeway are stored, and for how long.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Storage {
    /// Most bytes of frames of all its ropes; null or left out: as the disk allows.
    #[schema(minimum = 0, maximum = 1000000000000000_i64)]
    quota_bytes: Option<u64>,
    /// Days after which `ropescope retention` may remove frames that were inspected with a model; null or left out: never.
    #[schema(minimum = 1, maximum = 36500)]
    keep_days: Option<u32>,
}

/// Most bytes that can be said: a petabyte.
const MAX_QUOTA_BYTES: u64 = 1_000_000_000_000_000;

/// Longest time that can be said: a century.
const MAX_KEEP_DAYS: u32 = 36_500;

/// Say how many bytes the frames of a ropeway may take, and how long they are kept
#[utoipa::path(put, path = "/ropeways/{id}/storage", tag = "ropes", params(("id" = Uuid, Path, description = "The ropeway")),
    request_body = Storage, responses((status = 200, description = "The ropeway", body = Ropeway), WriteProblems))]
pub async fn put_storage(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<Storage>,
) -> Result<axum::Json<Ropeway>, Problem> {
    if let Some(bytes) = body.quota_bytes.filter(|&bytes| bytes > MAX_QUOTA_BYTES) {
        return Err(Problem::outside("quota_bytes", bytes as f64, 0.0, MAX_QUOTA_BYTES as f64));
    }
    if let Some(days) = body.keep_days.filter(|days| !(1..=MAX_KEEP_DAYS).contains(days)) {
        return Err(Problem::outside("keep_days", f64::from(days), 1.0, f64::from(MAX_KEEP_DAYS)));
    }
    let row = app.store.set_storage(Id(id), body.quota_bytes.map(|bytes| bytes as i64), body.keep_days).await?;
    Ok(axum::Json(row.ok_or_else(|| Problem::no("ropeway", id))?.into()))
}

/// A ropeway
#[utoipa::path(get, path = "/ropeways/{id}", tag = "ropes", params(("id" = Uuid, Path, description = "The ropeway")),
    responses((status = 200, description = "The ropeway", body = Ropeway), ReadProblems))]
pub async fn get_ropeway(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Ropeway>, Problem> {
    let row = app.store.ropeway(Id(id)).await?.ok_or_else(|| Problem::no("ropeway", id))?;
    Ok(axum::Json(row.into()))
}

/// All ropeways, newest first
#[utoipa::path(get, path = "/ropeways", tag = "ropes", params(PageQuery),
    responses((status = 200, description = "A page of ropeways", body = RopewayPage), ReadProblems))]
pub async fn list_ropeways(
    State(app): State<App>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<RopewayPage>, Problem> {
    Ok(axum::Json(app.store.ropeways(page.request()?).await?.try_into()?))
}
