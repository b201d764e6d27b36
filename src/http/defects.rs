//! Defects: look, confirm or dismiss, write the ticket back.

use super::auth::Caller;
use super::extract::{Json, Path, Query};
use super::pages::{PageQuery, page_of};
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{MAX_NAME, check_text};
use super::suggestion::{DefectKind, Suggestion};
use super::tables::{CsvTable, cell, wants_csv};
use super::{Problem, inspections, times};
use crate::app::App;
use crate::pipeline::results::AlarmRow;
use crate::store::defects::{self, Judged};
use crate::store::{Id, StoreError};
use axum::Extension;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Longest comment, in characters.
pub const MAX_COMMENT: usize = 4000;

/// A run of lines of one view above the threshold.
#[derive(Debug, Serialize, ToSchema)]
pub struct Alarm {
    /// The view.
    view: usize,
    /// First line.
    first_line: usize,
    /// Last line.
    last_line: usize,
    /// First column.
    first_column: usize,
    /// Last column.
    last_column: usize,
    /// Highest line score in it.
    peak_score: f64,
}

impl From<AlarmRow> for Alarm {
    fn from(a: AlarmRow) -> Self {
        Self {
            view: a.view,
            first_line: a.first_line,
            last_line: a.last_line,
            first_column: a.first_column,
            last_column: a.last_column,
            peak_score: a.peak_score,
        }
    }
}

/// What people decided about a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum DefectState {
    /// Nobody decided yet.
    Open,
    /// It is one.
    Confirmed,
    /// It is none.
    Dismissed,
}

/// How sure it is that something is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DefectLevel {
    /// Over the threshold: a defect.
    Alarm,
    /// Over the second level only: worth looking at again.
    LookAgain,
}

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

/// A decision, with who made it.
#[derive(Debug, Serialize, ToSchema)]
pub struct Decision {
    /// Who decided.
    #[schema(required)]
    by: Option<String>,
    /// What they said.
    #[schema(required)]
    comment: Option<String>,
    /// When.
    #[schema(required, format = DateTime)]
    at: Option<String>,
}

/// A ticket, as the maintenance system knows it.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Ticket {
    /// Its number there.
    #[schema(min_length = 1, max_length = 200)]
    number: String,
    /// Where people see it, http or https.
    #[schema(max_length = 2000)]
    url: Option<String>,
    /// Its state, in the words of that system.
    #[schema(min_length = 1, max_length = 200)]
    state: String,
}

/// Alarms of one cause, merged over lines, wires and views.
#[derive(Debug, Serialize, ToSchema)]
pub struct Defect {
    /// Id.
    defect_id: Uuid,
    /// The inspection that found it.
    inspection_id: Uuid,
    /// The rope.
    rope_id: Uuid,
    /// Number within the inspection, from 0: defects along the rope, then places to look at again along it.
    number: u32,
    /// Which threshold it is over.
    level: DefectLevel,
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Strand, if it is known.
    #[schema(required)]
    strand: Option<u32>,
    /// Wire in the strand, if it is known.
    #[schema(required)]
    wire: Option<u32>,
    /// Angle of its peak round the rope, rope axes: 0 faces a camera at angle 0; null in inspections of earlier versions.
    #[schema(required)]
    angle_deg: Option<f64>,
    /// Highest line score of its alarms.
    peak_score: f64,
    /// 1 for the highest peak of its level, and so on; null in inspections of earlier versions.
    #[schema(required)]
    rank: Option<u32>,
    /// What it is likely to be; null in inspections of earlier versions.
    #[schema(required)]
    suggestion: Option<Suggestion>,
    /// Its alarms.
    alarms: Vec<Alarm>,
    /// What people decided.
    state: DefectState,
    /// Who decided; null while it is open.
    #[schema(required)]
    verdict: Option<Decision>,
    /// The ticket; null until the maintenance system wrote it back.
    #[schema(required)]
    ticket: Option<Ticket>,
    /// When it was found.
    #[schema(format = DateTime)]
    created_at: String,
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

/// What a person decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum VerdictKind {
    /// It is a defect.
    Confirmed,
    /// It is none.
    Dismissed,
}

/// What a person decides about a defect.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewVerdict {
    /// The decision.
    verdict: VerdictKind,
    /// Who decides; else the name of the token.
    #[schema(min_length = 1, max_length = 200)]
    by: Option<String>,
    /// What they say.
    #[schema(max_length = 4000)]
    comment: Option<String>,
}

impl TryFrom<defects::Defect> for Defect {
    type Error = StoreError;

    fn try_from(row: defects::Defect) -> Result<Self, StoreError> {
        let alarms = row.alarms()?.into_iter().map(Alarm::from);
        let suggestion = row.suggestion()?.map(Suggestion::from);
        let state = match row.state.as_str() {
            "confirmed" => DefectState::Confirmed,
            "dismissed" => DefectState::Dismissed,
            _ => DefectState::Open,
        };
        let verdict = row.verdict_at_ms.map(|ms| Decision {
            by: row.verdict_by.clone(),
            comment: row.verdict_comment.clone(),
            at: Some(times::rfc3339(ms)),
        });
        let ticket = row.ticket_number.clone().map(|number| Ticket {
            number,
            url: row.ticket_url.clone(),
            state: row.ticket_state.clone().unwrap_or_default(),
        });
        Ok(Self {
            defect_id: row.id.0,
            inspection_id: row.inspection_id.0,
            rope_id: row.rope_id.0,
            number: row.number,
            level: if row.level == defects::LOOK_AGAIN { DefectLevel::LookAgain } else { DefectLevel::Alarm },
            from_m: row.from_m,
            to_m: row.to_m,
            strand: row.strand,
            wire: row.wire,
            angle_deg: row.angle_deg,
            peak_score: row.peak_score,
            rank: row.rank,
            suggestion,
            alarms: alarms.collect(),
            state,
            verdict,
            ticket,
            created_at: times::rfc3339(row.created_at_ms),
        })
    }
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
                cell(suggestion.as_ref().map(|s| DefectKind::from(s.kind).name())),
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

/// Confirm or dismiss a defect; a confirmation makes its ticket
#[utoipa::path(post, path = "/defects/{id}/verdict", tag = "defects", params(("id" = Uuid, Path, description = "The defect")),
    request_body = NewVerdict,
    responses((status = 200, description = "The defect as it is now", body = Defect), WriteProblems))]
pub async fn post_verdict(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Extension(caller): Extension<Caller>,
    Json(body): Json<NewVerdict>,
) -> Result<axum::Json<Defect>, Problem> {
    if let Some(by) = &body.by {
        check_text("by", by, 1, MAX_NAME)?;
    }
    if let Some(comment) = &body.comment {
        check_text("comment", comment, 0, MAX_COMMENT)?;
    }
    let verdict = defects::Verdict {
        confirmed: body.verdict == VerdictKind::Confirmed,
        by: body.by.unwrap_or(caller.name),
        comment: body.comment,
    };
    match app.store.judge(Id(id), &verdict, app.now_ms()).await? {
        Judged::Accepted(row) => {
            app.outbox_wake.notify_one();
            Ok(axum::Json(row.try_into()?))
        }
        Judged::Contradiction(row) => Err(Problem::verdict_differs(format!(
            "defect {id} was {} by {}; nothing was changed",
            row.state,
            row.verdict_by.as_deref().unwrap_or("somebody")
        ))
        .with("value", &row.state)),
        Judged::Unknown => Err(Problem::no("defect", id)),
    }
}

/// Write back number and state of the ticket
#[utoipa::path(put, path = "/defects/{id}/ticket", tag = "defects", params(("id" = Uuid, Path, description = "The defect")),
    request_body = Ticket,
    responses((status = 200, description = "The defect as it is now", body = Defect), WriteProblems))]
pub async fn put_ticket(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<Ticket>,
) -> Result<axum::Json<Defect>, Problem> {
    check_text("number", &body.number, 1, MAX_NAME)?;
    check_text("state", &body.state, 1, MAX_NAME)?;
    if let Some(url) = &body.url {
        check_text("url", url, 1, 2000)?;
        let web = ["http://", "https://"].iter().any(|scheme| url.starts_with(scheme));
        if !web {
            return Err(Problem::out_of_range(format!("url is {url:?}, but must begin with http:// or https://"))
                .with("field", "url")
                .with("value", url));
        }
    }
    let ticket = defects::Ticket { number: body.number, url: body.url, state: body.state };
    let row = app.store.set_ticket(Id(id), &ticket).await?.ok_or_else(|| Problem::no("defect", id))?;
    Ok(axum::Json(row.try_into()?))
}
