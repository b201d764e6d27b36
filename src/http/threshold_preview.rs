//! What another threshold would have changed in past inspections of a model: metres to re-inspect, defects opened and closed.

use super::extract::{Json, Path};
use super::inspections::Threshold;
use super::problem::WriteProblems;
use super::thresholds::check_line_score;
use super::{Problem, models};
use crate::app::App;
use crate::pipeline::rejudge::{Place, ScoreCourse, threshold_for};
use crate::pipeline::results;
use crate::store::{Id, StoreError, defects, inspections};
use axum::extract::State;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use utoipa::ToSchema;
use uuid::Uuid;

/// Inspections looked at unless asked otherwise.
const DEFAULT_INSPECTIONS: u32 = 10;
/// Most inspections looked at: each is read through once.
const MAX_INSPECTIONS: u32 = 20;

/// A threshold to be tried: a line score, or what it may cost.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum Wish {
    /// The threshold itself.
    LineScore(LineScoreWish),
    /// A budget.
    Budget(BudgetWish),
}

/// A threshold to be tried.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LineScoreWish {
    /// Lines with a score above it are alarms.
    #[schema(minimum = 0, maximum = 1000)]
    line_score: f64,
    /// How many inspections to look at, the newest ones; else 10.
    #[schema(minimum = 1, maximum = 20)]
    inspections: Option<u32>,
}

/// The least threshold that keeps a budget on past inspections. True alarms count too: it is what people have to look at.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BudgetWish {
    /// Most metres to re-inspect per 100 m of inspected rope.
    #[schema(minimum = 0, maximum = 100)]
    reinspect_m_per_100m: f64,
    /// How many inspections to look at, the newest ones; else 10.
    #[schema(minimum = 1, maximum = 20)]
    inspections: Option<u32>,
}

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
    /// The threshold it was made with.
    threshold: Threshold,
    /// Metres of rope that any view inspected.
    inspected_m: f64,
    /// With its own threshold.
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

impl Wish {
    fn inspections(self) -> Option<u32> {
        match self {
            Self::LineScore(wish) => wish.inspections,
            Self::Budget(wish) => wish.inspections,
        }
    }

    fn check(self) -> Result<(), Problem> {
        let n = self.inspections().unwrap_or(DEFAULT_INSPECTIONS);
        if !(1..=MAX_INSPECTIONS).contains(&n) {
            return Err(Problem::outside("inspections", f64::from(n), 1.0, f64::from(MAX_INSPECTIONS)));
        }
        match self {
            Self::LineScore(wish) => check_line_score(wish.line_score).map(|_| ()),
            Self::Budget(BudgetWish { reinspect_m_per_100m: m, .. }) if !(0.0..=100.0).contains(&m) => {
                Err(Problem::outside("reinspect_m_per_100m", m, 0.0, 100.0))
            }
            Self::Budget(_) => Ok(()),
        }
    }

    fn line_score(self, courses: &[ScoreCourse]) -> Result<f64, Problem> {
        match self {
            Self::LineScore(wish) => Ok(wish.line_score),
            Self::Budget(wish) => threshold_for(courses, wish.reinspect_m_per_100m).ok_or_else(|| {
                Problem::no_likelihood(
                    "no rope was inspected with this model yet, so a budget finds no threshold: inspect first",
                )
            }),
        }
    }
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
    models::load(&app, id).await?;
    let rows = app.store.inspections_with(Id(id), wish.inspections().unwrap_or(DEFAULT_INSPECTIONS)).await?;
    let mut past = Vec::with_capacity(rows.len());
    for row in rows {
        past.extend(gather(&app, row).await?);
    }
    let permit = app.cpu.clone().acquire_owned().await.map_err(Problem::failure)?;
    let judged = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        judge(id, past, wish)
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

fn judge(model_id: Uuid, past: Vec<Past>, wish: Wish) -> Result<ThresholdPreview, Problem> {
    let courses = past.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let line_score = wish.line_score(&courses)?;
    let inspections = past.into_iter().zip(&courses).map(|(past, course)| compare(past, course, line_score)).collect();
    Ok(ThresholdPreview { model_id, line_score, inspections })
}

fn read(past: &Past) -> Result<ScoreCourse, Problem> {
    let open = |path: &PathBuf| {
        let file = File::open(path).map_err(|e| Problem::failure(format!("{}: {e}", path.display())))?;
        Ok(BufReader::with_capacity(1 << 18, file))
    };
    let files = past.scores.iter().map(open).collect::<Result<Vec<_>, Problem>>()?;
    ScoreCourse::read(files, past.pitch_mm).map_err(Problem::failure)
}

fn compare(past: Past, course: &ScoreCourse, line_score: f64) -> PreviewedInspection {
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
    PreviewedInspection {
        inspection_id: past.row.id.0,
        threshold: past.threshold.into(),
        inspected_m: course.inspected_m(),
        before: Effort { reinspect_m: before.reinspect_m, defects },
        after: Effort { reinspect_m: after.reinspect_m, defects: defects - closed.len() + opened.len() },
        opened,
        closed,
    }
}
