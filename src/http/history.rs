//! Lay lengths and diameters over positions and dates: how a rope ages.

use super::buckets::{self, Bucket, buckets};
use super::extract::{Path, Query};
use super::lay_lengths::{check_buckets, range_m};
use super::problem::ReadProblems;
use super::tables::{CsvTable, Format, wants_csv};
use super::{Problem, ropes, times};
use crate::app::App;
use crate::store::ropes::Rope;
use crate::store::{Id, PageRequest};
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Buckets unless asked otherwise.
const DEFAULT_BUCKETS: u32 = 50;
/// Most inspections of a rope in one history; the newest ones.
const MAX_INSPECTIONS: u32 = 200;
/// Most ropes of a ropeway in one history.
const MAX_ROPES: u32 = 50;
/// Most buckets of all inspections together.
const MAX_CELLS: usize = 200_000;

/// Lay lengths of a rope on one date.
#[derive(Debug, Serialize, ToSchema)]
pub struct DatedInspection {
    /// The last inspection of its acquisition.
    inspection_id: Uuid,
    /// The acquisition.
    acquisition_id: Uuid,
    /// When the rope was acquired (uploaded, if nobody said).
    #[schema(format = DateTime)]
    acquired_at: String,
    /// Fused lay lengths and diameters; the same buckets for every inspection of the rope.
    buckets: Vec<Bucket>,
}

/// History of one rope.
#[derive(Debug, Serialize, ToSchema)]
pub struct RopeHistory {
    /// The rope.
    rope_id: Uuid,
    /// Its name.
    name: String,
    /// Nominal strand lay in mm, signed.
    #[schema(required)]
    strand_lay_mm: Option<f64>,
    /// Nominal wire lay in mm, signed.
    #[schema(required)]
    wire_lay_mm: Option<f64>,
    /// Allowed departure of the strand lay in mm.
    #[schema(required)]
    strand_lay_tolerance_mm: Option<f64>,
    /// Allowed departure of the wire lay in mm.
    #[schema(required)]
    wire_lay_tolerance_mm: Option<f64>,
    /// One entry an acquisition, oldest first, at most 200 (the newest).
    inspections: Vec<DatedInspection>,
}

/// Lay lengths over positions and dates.
#[derive(Debug, Serialize, ToSchema)]
pub struct History {
    /// The ropes.
    ropes: Vec<RopeHistory>,
}

/// Which part of the history.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct HistoryQuery {
    /// Rope metre from which on.
    from_m: Option<f64>,
    /// Rope metre up to which.
    to_m: Option<f64>,
    /// Divide the range into so many buckets, else 50.
    #[param(minimum = 1, maximum = 5000)]
    buckets: Option<u32>,
    /// Acquired at or after, RFC 3339.
    #[param(format = DateTime)]
    from: Option<String>,
    /// Acquired before, RFC 3339.
    #[param(format = DateTime)]
    to: Option<String>,
    /// `json` (default) or `csv`; `Accept: text/csv` does too.
    #[param(inline)]
    format: Option<Format>,
}

/// Lay-length history of a rope
#[utoipa::path(get, path = "/ropes/{id}/lay-length-history", tag = "history",
    params(("id" = Uuid, Path, description = "The rope"), HistoryQuery),
    responses((status = 200, description = "Position by date", content((History = "application/json"), (String = "text/csv"))), ReadProblems))]
pub async fn get_rope_history(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<HistoryQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let rope = ropes::load(&app, id).await?;
    answer(&app, vec![rope], &query, &headers).await
}

/// Lay-length history of all ropes of a ropeway
#[utoipa::path(get, path = "/ropeways/{id}/lay-length-history", tag = "history",
    params(("id" = Uuid, Path, description = "The ropeway"), HistoryQuery),
    responses((status = 200, description = "Position by date", content((History = "application/json"), (String = "text/csv"))), ReadProblems))]
pub async fn get_ropeway_history(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<HistoryQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    app.store.ropeway(Id(id)).await?.ok_or_else(|| Problem::no("ropeway", id))?;
    let mut ropes = app.store.ropes(Some(Id(id)), PageRequest { before: None, limit: MAX_ROPES }).await?.items;
    ropes.reverse(); // as they were created
    answer(&app, ropes, &query, &headers).await
}

async fn answer(app: &App, ropes: Vec<Rope>, query: &HistoryQuery, headers: &HeaderMap) -> Result<Response, Problem> {
    let n = check_buckets(query.buckets.unwrap_or(DEFAULT_BUCKETS))?;
    let time = |field, text: &Option<String>, other| text.as_deref().map_or(Ok(other), |t| times::parse(field, t));
    let (from_ms, to_ms) = (time("from", &query.from, i64::MIN)?, time("to", &query.to, i64::MAX)?);
    range_m(query.from_m, query.to_m, None)?;
    let mut histories = Vec::with_capacity(ropes.len());
    let mut cells = 0;
    for rope in ropes {
        let history = rope_history(app, &rope, query, n, (from_ms, to_ms)).await?;
        cells += history.inspections.len() * n as usize;
        if cells > MAX_CELLS {
            return Err(Problem::range_too_large(format!(
                "the history has more than {MAX_CELLS} buckets in all: ask for fewer buckets or a shorter time"
            ))
            .limit(cells, MAX_CELLS));
        }
        histories.push((rope.design.strands as usize, history));
    }
    if wants_csv(query.format, headers) {
        return csv(&histories);
    }
    Ok(axum::Json(History { ropes: histories.into_iter().map(|(_, history)| history).collect() }).into_response())
}

async fn rope_history(
    app: &App,
    rope: &Rope,
    query: &HistoryQuery,
    n: u32,
    (from_ms, to_ms): (i64, i64),
) -> Result<RopeHistory, Problem> {
    let dated = app.store.inspections_by_date(rope.id, from_ms, to_ms, MAX_INSPECTIONS).await?;
    // One grid for all dates, or positions could not be compared.
    let mut span: Option<(f64, f64)> = None;
    for (inspection, ..) in &dated {
        if let Some((from, to)) = app.store.lay_length_span(*inspection).await? {
            span = Some(span.map_or((from, to), |(first, last)| (first.min(from), last.max(to))));
        }
    }
    let (from_m, to_m) = range_m(query.from_m, query.to_m, span)?;
    let mut inspections = Vec::with_capacity(dated.len());
    for (inspection, acquisition, at_ms) in dated {
        let stretches = app.store.lay_lengths(inspection, None, from_m, to_m).await?;
        let strands = rope.design.strands as usize;
        let buckets = if to_m > from_m { buckets(&stretches, from_m, to_m, n, strands) } else { Vec::new() };
        inspections.push(DatedInspection {
            inspection_id: inspection.0,
            acquisition_id: acquisition.0,
            acquired_at: times::rfc3339(at_ms),
            buckets,
        });
    }
    Ok(RopeHistory {
        rope_id: rope.id.0,
        name: rope.name.clone(),
        strand_lay_mm: rope.design.strand_lay_mm,
        wire_lay_mm: rope.design.wire_lay_mm,
        strand_lay_tolerance_mm: rope.design.strand_lay_tolerance_mm,
        wire_lay_tolerance_mm: rope.design.wire_lay_tolerance_mm,
        inspections,
    })
}

fn csv(histories: &[(usize, RopeHistory)]) -> Result<Response, Problem> {
    let strands = histories.iter().map(|(strands, _)| *strands).max().unwrap_or(0);
    let mut columns: Vec<String> = ["rope_id", "inspection_id", "acquired_at"].map(str::to_owned).into();
    columns.extend(buckets::columns(strands));
    let mut table = CsvTable::new(&columns)?;
    for (_, history) in histories {
        for inspection in &history.inspections {
            for bucket in &inspection.buckets {
                let mut bucket = bucket.clone();
                bucket.wire_lay_mm.resize(strands, None); // ropes of a ropeway may differ in strands
                let mut cells = vec![
                    history.rope_id.to_string(),
                    inspection.inspection_id.to_string(),
                    inspection.acquired_at.clone(),
                ];
                cells.extend(buckets::cells(&bucket));
                table.row(&cells)?;
            }
        }
    }
    table.finish()
}
