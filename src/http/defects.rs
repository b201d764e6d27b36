//! Defects: of an inspection, and of everything.

use super::defect::{Defect, DefectState};
use super::extract::{Path, Query};
use super::pages::{PageQuery, page_of};
use super::problem::ReadProblems;
use super::tables::{CsvTable, cell, wants_csv};
use super::{Problem, inspections};
use crate::app::App;
use crate::store::{Id, defects};
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Which levels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LevelFilter {
    /// Defects only.
    #[default]
    Alarm,
    /// Places to look at again only.
    LookAgain,
    /// Both.
    Any,
}

impl LevelFilter {
    fn name(self) -> Option<&'static str> {
        match self {
            Self::Alarm => Some(defects::ALARM),
            Self::LookAgain => Some(defects::LOOK_AGAIN),
            Self::Any => None,
        }
    }
}

/// Which of the places that an inspection found.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct LevelQuery {
    /// `json` (default) or `csv`; else as the Accept header asks.
    #[param(inline)]
    format: Option<super::tables::Format>,
    /// `alarm` (default): defects; `look_again`: places under the threshold that are worth a second look; `any`: both.
    #[param(inline)]
    #[serde(default)]
    level: LevelFilter,
}

/// All defects of an inspection.
#[derive(Debug, Serialize, ToSchema)]
pub struct DefectList {
    /// The defects, along the rope.
    items: Vec<Defect>,
}

/// Which defects.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct DefectFilter {
    /// Only those of this rope.
    rope_id: Option<Uuid>,
    /// Only those in this state.
    #[param(inline)]
    state: Option<DefectState>,
    /// `alarm` (default): defects; `look_again`: places under the threshold that are worth a second look; `any`: both.
    #[param(inline)]
    #[serde(default)]
    level: LevelFilter,
}

page_of!(
    /// A page of defects.
    DefectPage, Defect, defects::Defect
);

/// Defects of an inspection, along the rope
#[utoipa::path(get, path = "/inspections/{id}/defects", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection"), LevelQuery),
    responses((status = 200, description = "Its defects", content((DefectList = "application/json"), (String = "text/csv"))), ReadProblems))]
pub async fn get_inspection_defects(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<LevelQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    inspections::load(&app, id).await?;
    let rows = app.store.found_in(Id(id), query.level.name()).await?;
    if wants_csv(query.format, &headers) {
        let mut table = CsvTable::new(&[
            "defect_id",
            "number",
            "level",
            "from_m",
            "to_m",
            "strand",
            "wire",
            "angle_deg",
            "peak_score",
            "rank",
            "kind",
            "area_mm2",
            "alarms",
            "state",
            "ticket_number",
        ])?;
        for row in rows {
            let suggestion = row.suggestion()?;
            table.row(&[
                row.id.to_string(),
                row.number.to_string(),
                row.level.clone(),
                row.from_m.to_string(),
                row.to_m.to_string(),
                cell(row.strand),
                cell(row.wire),
                cell(row.angle_deg),
                row.peak_score.to_string(),
                cell(row.rank),
                cell(suggestion.as_ref().map(|s| s.kind.name())),
                cell(suggestion.as_ref().map(|s| s.area_mm2)),
                row.alarms()?.len().to_string(),
                row.state,
                cell(row.ticket_number),
            ])?;
        }
        return table.finish();
    }
    let items = rows.into_iter().map(Defect::try_from).collect::<Result<_, _>>()?;
    Ok(axum::Json(DefectList { items }).into_response())
}

/// Defects, newest first
#[utoipa::path(get, path = "/defects", tag = "defects", params(DefectFilter, PageQuery),
    responses((status = 200, description = "A page of defects", body = DefectPage), ReadProblems))]
pub async fn list_defects(
    State(app): State<App>,
    Query(filter): Query<DefectFilter>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<DefectPage>, Problem> {
    let state = filter.state.map(|state| match state {
        DefectState::Open => "open",
        DefectState::Confirmed => "confirmed",
        DefectState::Dismissed => "dismissed",
    });
    Ok(axum::Json(
        app.store.defects(filter.rope_id.map(Id), state, filter.level.name(), page.request()?).await?.try_into()?,
    ))
}

/// The defect of a path.
pub async fn load(app: &App, id: Uuid) -> Result<defects::Defect, Problem> {
    app.store.defect(Id(id)).await?.ok_or_else(|| Problem::no("defect", id))
}

/// A defect
#[utoipa::path(get, path = "/defects/{id}", tag = "defects", params(("id" = Uuid, Path, description = "The defect")),
    responses((status = 200, description = "The defect", body = Defect), ReadProblems))]
pub async fn get_defect(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Defect>, Problem> {
    Ok(axum::Json(load(&app, id).await?.try_into()?))
}
