//! What another threshold would have changed in past inspections of a model: metres to re-inspect, defects opened and closed.

use super::budgets::Level;
use super::extract::{Json, Path};
use super::inspections::Threshold;
use super::problem::WriteProblems;
use super::threshold_wish::Wish;
use super::{Problem, models};
use crate::app::App;
use crate::pipeline::budget::BudgetFit;
use crate::pipeline::rejudge::{MetresToLookAt, Place, ScoreCourse};
use crate::pipeline::results;
use crate::store::{Id, StoreError, defects, inspections};
use axum::extract::State;
use serde::Serialize;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use utoipa::ToSchema;
use uuid::Uuid;

/// A place that would become a defect.
#[derive(Debug, Serialize, ToSchema)]
pub struct OpenedPlace {
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Highest line score in it.
    peak_score: f64,
}

/// A defect that would not have been reported.
#[derive(Debug, Serialize, ToSchema)]
pub struct ClosedDefect {
    /// The defect.
    defect_id: Uuid,
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Highest line score in it.
    peak_score: f64,
    /// What people decided about it: `open`, `confirmed`, `dismissed`.
    state: String,
}

/// What a threshold asks of people.
#[derive(Debug, Serialize, ToSchema)]
pub struct Effort {
    /// Metres of rope to look at: alarms of any view, each with 5 cm of context.
    reinspect_m: f64,
    /// Defects.
    defects: usize,
}

/// One inspection under both thresholds.
#[derive(Debug, Serialize, ToSchema)]
pub struct PreviewedInspection {
    /// The inspection.
    inspection_id: Uuid,
    /// The threshold in force.
    threshold: Threshold,
    /// Metres of rope that any view inspected.
    inspected_m: f64,
    /// With the threshold in force.
    before: Effort,
    /// With the one that is tried.
    after: Effort,
    /// Places that would become defects. Scores do not tell strands apart: two strands at one place are one.
    opened: Vec<OpenedPlace>,
    /// Defects that would not have been reported.
    closed: Vec<ClosedDefect>,
}

/// What another threshold would have changed. Nothing was computed anew but decisions, and nothing was stored.
#[derive(Debug, Serialize, ToSchema)]
pub struct ThresholdPreview {
    /// The model.
    model_id: Uuid,
    /// The threshold that was tried; found, if a budget was given.
    line_score: f64,
    /// What it costs on intact rope, by the tail of the training, with the interval that holds the true rate with 95 %. Null where that does
    /// not tell: outside 0.1 to 100 false defects per 100 m, under the tail, and in models of earlier versions.
    #[schema(required)]
    on_intact_rope: Option<Level>,
    /// The newest inspections with this model, newest first.
    inspections: Vec<PreviewedInspection>,
}

/// A past inspection, as far as it is needed to judge it anew.
struct Past {
    row: inspections::Inspection,
    threshold: results::Threshold,
    start_m: f64,
    pitch_mm: f64,
    scores: Vec<PathBuf>,
    found: Vec<(defects::Defect, std::ops::RangeInclusive<usize>)>,
}

/// Try another threshold on past inspections of a model, from their stored line scores
#[utoipa::path(post, path = "/models/{id}/threshold-preview", tag = "models", params(("id" = Uuid, Path, description = "The model")),
    request_body = Wish,
    responses((status = 200, description = "What it would have changed", body = ThresholdPreview), WriteProblems))]
pub async fn preview_threshold(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(wish): Json<Wish>,
) -> Result<axum::Json<ThresholdPreview>, Problem> {
    wish.check()?;
    let trained = models::load(&app, id).await?.report()?.budget;
    let rows = app.store.inspections_with(Id(id), wish.inspections()).await?;
    let mut past = Vec::with_capacity(rows.len());
    for row in rows {
        past.extend(gather(&app, row).await?);
    }
    let permit = app.cpu.clone().acquire_owned().await.map_err(Problem::failure)?;
    let judged = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        judge(id, past, trained.as_ref(), wish)
    });
    Ok(axum::Json(judged.await.map_err(Problem::failure)??))
}

async fn gather(app: &App, row: inspections::Inspection) -> Result<Option<Past>, Problem> {
    let Some(threshold) = row.summary()?.threshold else { return Ok(None) }; // nothing was judged
    let acquisition = super::acquisitions::load(app, row.acquisition_id.0).await?;
    let scores = acquisition.views.iter().map(|v| app.store.folder().line_scores(row.id, v.view)).collect();
    let found = app.store.defects_of(row.id).await?.into_iter().map(with_lines).collect::<Result<_, _>>()?;
    let (start_m, pitch_mm) = (acquisition.row.start_m, acquisition.row.line_pitch_mm);
    Ok(Some(Past { row, threshold, start_m, pitch_mm, scores, found }))
}

fn with_lines(defect: defects::Defect) -> Result<(defects::Defect, std::ops::RangeInclusive<usize>), StoreError> {
    let alarms = defect.alarms()?;
    let first = alarms.iter().map(|a| a.first_line).min().unwrap_or(0);
    let last = alarms.iter().map(|a| a.last_line).max().unwrap_or(0);
    Ok((defect, first..=last))
}

/// Judges one inspection after the other: the scores of a long rope fill a hundred megabytes.
fn judge(
    model_id: Uuid,
    past: Vec<Past>,
    trained: Option<&BudgetFit>,
    wish: Wish,
) -> Result<ThresholdPreview, Problem> {
    let (line_score, on_intact_rope) = wish.threshold(trained, || to_look_at(&past))?;
    let inspections = past.into_iter().map(|past| compare(past, line_score)).collect::<Result<Vec<_>, _>>()?;
    Ok(ThresholdPreview { model_id, line_score, on_intact_rope: on_intact_rope.map(Level::from), inspections })
}

fn to_look_at(past: &[Past]) -> Result<MetresToLookAt, Problem> {
    let mut metres = MetresToLookAt::default();
    for inspection in past {
        metres.add(&read(inspection)?);
    }
    Ok(metres)
}

fn read(past: &Past) -> Result<ScoreCourse, Problem> {
    let open = |path: &PathBuf| {
        let file = File::open(path).map_err(|e| Problem::failure(format!("{}: {e}", path.display())))?;
        Ok(BufReader::with_capacity(1 << 18, file))
    };
    let files = past.scores.iter().map(open).collect::<Result<Vec<_>, Problem>>()?;
    ScoreCourse::read(files, past.pitch_mm).map_err(Problem::failure)
}

fn compare(past: Past, line_score: f64) -> Result<PreviewedInspection, Problem> {
    let course = read(&past)?;
    let before = course.judge(past.threshold.line_score);
    let after = course.judge(line_score);
    let metre = |line: usize| past.start_m + line as f64 * past.pitch_mm / 1000.0;
    // What touches a known defect is that defect, wider than before.
    let known = |p: &Place| past.found.iter().any(|(_, l)| p.first_line <= *l.end() && p.last_line >= *l.start());
    let opened: Vec<OpenedPlace> = after
        .places
        .iter()
        .filter(|place| !known(place))
        .map(|p| OpenedPlace { from_m: metre(p.first_line), to_m: metre(p.last_line + 1), peak_score: p.peak_score })
        .collect();
    let closed: Vec<ClosedDefect> = past
        .found
        .iter()
        .filter(|(defect, _)| defect.peak_score <= line_score)
        .map(|(defect, _)| ClosedDefect {
            defect_id: defect.id.0,
            from_m: defect.from_m,
            to_m: defect.to_m,
            peak_score: defect.peak_score,
            state: defect.state.clone(),
        })
        .collect();
    let defects = past.found.len();
    Ok(PreviewedInspection {
        inspection_id: past.row.id.0,
        threshold: past.threshold.into(),
        inspected_m: course.inspected_m(),
        before: Effort { reinspect_m: before.reinspect_m, defects },
        after: Effort { reinspect_m: after.reinspect_m, defects: defects - closed.len() + opened.len() },
        opened,
        closed,
    })
}
