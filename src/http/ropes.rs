//! Ropes and their designs.

use super::extract::{Json, Path, Query};
use super::pages::{PageQuery, page_of};
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{MAX_NAME, check_text, choose_id, created};
use super::{Problem, times};
use crate::app::App;
use crate::store::{Id, ropes};
use crate::vision::rope::Violation;
use axum::extract::State;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Largest tolerance that makes sense, in mm: longer than any lay.
const MAX_TOLERANCE_MM: f64 = 1000.0;

/// How a rope is built. Lay lengths are signed: + is right-hand, in the axes of the design.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Design {
    /// Number of strands.
    #[schema(minimum = 3, maximum = 8, example = 6)]
    pub strands: u32,
    /// Number of outer wires per strand.
    #[schema(minimum = 5, maximum = 16, example = 9)]
    pub wires_per_strand: u32,
    /// Rope diameter in mm.
    #[schema(minimum = 1, maximum = 200, example = 32.0)]
    pub rope_diameter_mm: f64,
    /// Nominal strand lay in mm, signed; null if unknown.
    #[schema(example = 220.0)]
    pub strand_lay_mm: Option<f64>,
    /// Nominal wire lay in mm against the fixed axes, signed; null if unknown.
    #[schema(example = -95.0)]
    pub wire_lay_mm: Option<f64>,
    /// Strand diameter in mm, if the maker states it.
    pub strand_diameter_mm: Option<f64>,
    /// Wire diameter in mm, if the maker states it.
    pub wire_diameter_mm: Option<f64>,
    /// How far the strand lay may depart from nominal, in mm.
    #[schema(minimum = 0, maximum = 1000)]
    pub strand_lay_tolerance_mm: Option<f64>,
    /// How far the wire lay may depart from nominal, in mm.
    #[schema(minimum = 0, maximum = 1000)]
    pub wire_lay_tolerance_mm: Option<f64>,
}

/// A rope.
#[derive(Debug, Serialize, ToSchema)]
pub struct Rope {
    /// Id.
    id: Uuid,
    /// The ropeway it belongs to.
    ropeway_id: Uuid,
    /// Its name.
    name: String,
    /// How it is built.
    design: Design,
    /// Peak score at or above which a defect is ticketed without a person; null: never.
    #[schema(required)]
    ticket_level: Option<f64>,
    /// When it was created.
    #[schema(format = DateTime)]
    created_at: String,
}

/// A rope to be created.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewRope {
    /// Id, if the client chooses it.
    id: Option<Uuid>,
    /// The ropeway it belongs to.
    ropeway_id: Uuid,
    /// Its name.
    #[schema(min_length = 1, max_length = 200)]
    name: String,
    /// How it is built.
    design: Design,
    /// Peak score at or above which a defect is ticketed without a person.
    ticket_level: Option<f64>,
}

/// When defects of a rope are ticketed without a person.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Ticketing {
    /// Peak score at or above which; null: never.
    #[serde(deserialize_with = "Option::deserialize")] // null has to be said
    #[schema(required)]
    ticket_level: Option<f64>,
}

/// Which ropes.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct RopeFilter {
    /// Only those of this ropeway.
    ropeway_id: Option<Uuid>,
}

impl From<Design> for ropes::Design {
    fn from(d: Design) -> Self {
        Self {
            strands: d.strands,
            wires_per_strand: d.wires_per_strand,
            rope_diameter_mm: d.rope_diameter_mm,
            strand_lay_mm: d.strand_lay_mm,
            wire_lay_mm: d.wire_lay_mm,
            strand_diameter_mm: d.strand_diameter_mm,
            wire_diameter_mm: d.wire_diameter_mm,
            strand_lay_tolerance_mm: d.strand_lay_tolerance_mm,
            wire_lay_tolerance_mm: d.wire_lay_tolerance_mm,
        }
    }
}

impl From<ropes::Rope> for Rope {
    fn from(row: ropes::Rope) -> Self {
        let d = row.design;
        Self {
            id: row.id.0,
            ropeway_id: row.ropeway_id.0,
            name: row.name,
            design: Design {
                strands: d.strands,
                wires_per_strand: d.wires_per_strand,
                rope_diameter_mm: d.rope_diameter_mm,
                strand_lay_mm: d.strand_lay_mm,
                wire_lay_mm: d.wire_lay_mm,
                strand_diameter_mm: d.strand_diameter_mm,
                wire_diameter_mm: d.wire_diameter_mm,
                strand_lay_tolerance_mm: d.strand_lay_tolerance_mm,
                wire_lay_tolerance_mm: d.wire_lay_tolerance_mm,
            },
            ticket_level: row.ticket_level,
            created_at: times::rfc3339(row.created_at_ms),
        }
    }
}

page_of!(
    /// A page of ropes.
    RopePage, Rope, ropes::Rope
);

/// Refuses a design that is no rope, with everything that is wrong with it.
fn check_design(design: &Design) -> Result<(), Problem> {
    for (name, tolerance) in [
        ("strand_lay_tolerance_mm", design.strand_lay_tolerance_mm),
        ("wire_lay_tolerance_mm", design.wire_lay_tolerance_mm),
    ] {
        if let Some(mm) = tolerance
            && !(0.0..=MAX_TOLERANCE_MM).contains(&mm)
        {
            return Err(Problem::outside(name, mm, 0.0, MAX_TOLERANCE_MM));
        }
    }
    let Err(error) = ropes::Design::from(design.clone()).rope_design().validate() else { return Ok(()) };
    let violations: Vec<_> = error.0.iter().map(violation).collect();
    Err(Problem::design_impossible(error.to_string()).with("violations", violations))
}

fn violation(violation: &Violation) -> serde_json::Value {
    let detail = violation.to_string();
    match violation {
        Violation::OutOfRange { quantity, value, min, max } => {
            json!({ "quantity": quantity, "value": value, "limit": { "min": min, "max": max }, "detail": detail })
        }
        Violation::StrandsDoNotFit { strand_diameter_mm, largest_mm, .. } => {
            json!({ "quantity": "strand_diameter_mm", "value": strand_diameter_mm, "limit": { "max": largest_mm }, "detail": detail })
        }
        Violation::WiresDoNotFit { wire_diameter_mm, largest_mm, .. } => {
            json!({ "quantity": "wire_diameter_mm", "value": wire_diameter_mm, "limit": { "max": largest_mm }, "detail": detail })
        }
    }
}

async fn create(app: &App, id: Option<Uuid>, body: NewRope) -> Result<Response, Problem> {
    check_text("name", &body.name, 1, MAX_NAME)?;
    check_design(&body.design)?;
    let id = choose_id(app, id, body.id)?;
    if app.store.ropeway(Id(body.ropeway_id)).await?.is_none() {
        return Err(Problem::unknown_reference(format!("there is no ropeway {}", body.ropeway_id))
            .with("field", "ropeway_id")
            .with("value", body.ropeway_id));
    }
    let new = ropes::NewRope {
        id,
        ropeway_id: Id(body.ropeway_id),
        name: body.name,
        design: body.design.into(),
        ticket_level: body.ticket_level,
    };
    let outcome = app.store.create_rope(&new, app.now_ms()).await?;
    created(outcome, format!("/api/v1/ropes/{id}"), |row| Ok(Rope::from(row)))
}

/// Create a rope
#[utoipa::path(post, path = "/ropes", tag = "ropes", request_body = NewRope, responses(
    (status = 201, description = "It was created", body = Rope, headers(("location" = String, description = "Its address"))),
    (status = 200, description = "It was there with the same content", body = Rope),
    WriteProblems))]
pub async fn create_rope(State(app): State<App>, Json(body): Json<NewRope>) -> Result<Response, Problem> {
    create(&app, None, body).await
}

/// Create a rope under an id of the client's choice
#[utoipa::path(put, path = "/ropes/{id}", tag = "ropes", params(("id" = Uuid, Path, description = "The rope")),
    request_body = NewRope, responses(
    (status = 201, description = "It was created", body = Rope, headers(("location" = String, description = "Its address"))),
    (status = 200, description = "It was there with the same content", body = Rope),
    WriteProblems))]
pub async fn put_rope(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<NewRope>,
) -> Result<Response, Problem> {
    create(&app, Some(id), body).await
}

/// The rope of a path.
pub async fn load(app: &App, id: Uuid) -> Result<ropes::Rope, Problem> {
    app.store.rope(Id(id)).await?.ok_or_else(|| Problem::no("rope", id))
}

/// A rope
#[utoipa::path(get, path = "/ropes/{id}", tag = "ropes", params(("id" = Uuid, Path, description = "The rope")),
    responses((status = 200, description = "The rope", body = Rope), ReadProblems))]
pub async fn get_rope(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Rope>, Problem> {
    Ok(axum::Json(load(&app, id).await?.into()))
}

/// Ropes, newest first
#[utoipa::path(get, path = "/ropes", tag = "ropes", params(RopeFilter, PageQuery),
    responses((status = 200, description = "A page of ropes", body = RopePage), ReadProblems))]
pub async fn list_ropes(
    State(app): State<App>,
    Query(filter): Query<RopeFilter>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<RopePage>, Problem> {
    Ok(axum::Json(app.store.ropes(filter.ropeway_id.map(Id), page.request()?).await?.try_into()?))
}

/// Set from which peak score on defects are ticketed without a person
#[utoipa::path(patch, path = "/ropes/{id}/ticketing", tag = "ropes", params(("id" = Uuid, Path, description = "The rope")),
    request_body = Ticketing,
    responses((status = 200, description = "The rope as it is now", body = Rope), WriteProblems))]
pub async fn patch_ticketing(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<Ticketing>,
) -> Result<axum::Json<Rope>, Problem> {
    let row = app.store.set_ticket_level(Id(id), body.ticket_level).await?.ok_or_else(|| Problem::no("rope", id))?;
    Ok(axum::Json(row.into()))
}
