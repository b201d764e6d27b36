//! Surface alarms of an inspection, counted over windows of rope as rules for ropes want it.
//!
//! A surface alarm is a defect that nobody dismissed: a place that does not look as intact rope does. It is not a count of
//! broken wires, which only a person at the rope can give.

use super::extract::{Path, Query};
use super::inspections::{self, NotCovered};
use super::problem::ReadProblems;
use super::rope_windows;
use super::tables::{FormatQuery, csv_answer, wants_csv};
use super::{Problem, ropes};
use crate::app::App;
use crate::pipeline::surface_alarms::{self, RopeWindow, UnitLengths};
use crate::pipeline::windows::Span;
use crate::store::Id;
use crate::store::defects::{ALARM, Defect};
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

/// Most windows of an answer, of all lengths together.
const MAX_WINDOWS: usize = 100_000;

/// Where the length of windows comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum LengthOrigin {
    /// From the design of the rope.
    Designed,
    /// From what was measured in this inspection, on average.
    Measured,
}

/// A window of rope with what is in it.
#[derive(Debug, Serialize, ToSchema)]
pub struct AlarmWindow {
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Surface alarms that touch it: defects that were not dismissed, not broken wires.
    surface_alarms: usize,
    /// True when that is over the limit; null if there is none.
    #[schema(required)]
    over_limit: Option<bool>,
    /// Metres times views of it that were not inspected. Not covered is not intact.
    not_covered_view_m: f64,
    /// Why they were not.
    not_covered_reasons: Vec<String>,
}

/// Surface alarms over windows of one length.
#[derive(Debug, Serialize, ToSchema)]
pub struct AlarmWindows {
    /// The length as it is stated for the rope, and its limit.
    window: rope_windows::RopeWindow,
    /// The length in m; null if it is not known.
    #[schema(required)]
    length_m: Option<f64>,
    /// Where that comes from.
    #[schema(required)]
    length_origin: Option<LengthOrigin>,
    /// The window, anywhere on the rope, with most surface alarms; null if its length is not known.
    #[schema(required)]
    worst: Option<AlarmWindow>,
    /// Windows side by side along the rope.
    series: Vec<AlarmWindow>,
    /// Why there are none; null if there are.
    #[schema(required)]
    reason: Option<String>,
}

/// Surface alarms of an inspection over windows of rope.
#[derive(Debug, Serialize, ToSchema)]
pub struct SurfaceAlarms {
    /// The inspection.
    inspection_id: Uuid,
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Surface alarms in all: defects that were not dismissed, not broken wires.
    surface_alarms: usize,
    /// What was not inspected, with reasons. Not covered is not intact.
    not_covered: Vec<NotCovered>,
    /// One entry a length, as set for the rope.
    windows: Vec<AlarmWindows>,
}

/// Surface alarms per window of so many diameters and lay lengths. They are places that do not look intact, not broken wires
#[utoipa::path(get, path = "/inspections/{id}/surface-alarms", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection"), FormatQuery),
    responses((status = 200, description = "Surface alarms per window", content((SurfaceAlarms = "application/json"), (String = "text/csv"))), ReadProblems))]
pub async fn get_surface_alarms(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<FormatQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let inspection = inspections::load(&app, id).await?;
    if inspection.model_id.is_none() {
        return Err(Problem::no_likelihood("the inspection was made without a model, so it has no surface alarms"));
    }
    let summary = inspection.summary()?;
    let start_m = super::acquisitions::load(&app, inspection.acquisition_id.0).await?.row.start_m;
    let rope = Span { from_m: start_m, to_m: start_m + summary.metres };
    let design = ropes::load(&app, inspection.rope_id.0).await?.design;
    let stretches = app.store.lay_lengths(Id(id), None, rope.from_m, rope.to_m).await?;
    let lays_mm = stretches.iter().filter_map(|s| s.row.strand_lay_mm);
    let lengths = UnitLengths::new(design.rope_diameter_mm, design.strand_lay_mm, lays_mm);
    let found = app.store.found_in(Id(id), None).await?;
    // A place to look at again counts as soon as somebody has looked and confirmed it.
    let counts = |d: &&Defect| d.state == "confirmed" || (d.level == ALARM && d.state != "dismissed");
    let spans: Vec<Span> = found.iter().filter(counts).map(|d| Span { from_m: d.from_m, to_m: d.to_m }).collect();
    let alarms = surface_alarms::SurfaceAlarms::new(rope, lengths, &spans, &summary.not_covered);
    let windows = app.store.rope_windows(inspection.rope_id).await?;
    check(&alarms, &windows, rope)?;
    let windows: Vec<_> = windows.into_iter().map(|window| alarms.over(window)).collect();
    if wants_csv(query.format, &headers) {
        let mut bytes = Vec::new();
        surface_alarms::write_csv(&windows, &mut bytes).map_err(Problem::failure)?;
        return Ok(csv_answer(bytes));
    }
    let answer = SurfaceAlarms {
        inspection_id: id,
        from_m: rope.from_m,
        to_m: rope.to_m,
        surface_alarms: spans.len(),
        not_covered: summary.not_covered.iter().cloned().map(NotCovered::from).collect(),
        windows: windows.into_iter().map(AlarmWindows::from).collect(),
    };
    Ok(axum::Json(answer).into_response())
}

impl From<surface_alarms::LengthOrigin> for LengthOrigin {
    fn from(origin: surface_alarms::LengthOrigin) -> Self {
        match origin {
            surface_alarms::LengthOrigin::Designed => Self::Designed,
            surface_alarms::LengthOrigin::Measured => Self::Measured,
        }
    }
}

impl From<surface_alarms::AlarmWindow> for AlarmWindow {
    fn from(w: surface_alarms::AlarmWindow) -> Self {
        Self {
            from_m: w.span.from_m,
            to_m: w.span.to_m,
            surface_alarms: w.surface_alarms,
            over_limit: w.over_limit,
            not_covered_view_m: w.not_covered_view_m,
            not_covered_reasons: w.not_covered_reasons,
        }
    }
}

impl From<surface_alarms::AlarmWindows> for AlarmWindows {
    fn from(w: surface_alarms::AlarmWindows) -> Self {
        Self {
            window: w.window.into(),
            length_m: w.length_m.map(|(length_m, _)| length_m),
            length_origin: w.length_m.map(|(_, origin)| origin.into()),
            worst: w.worst.map(AlarmWindow::from),
            series: w.series.into_iter().map(AlarmWindow::from).collect(),
            reason: w.reason.map(str::to_owned),
        }
    }
}

/// Refuses more windows than one answer may have.
fn check(alarms: &surface_alarms::SurfaceAlarms<'_>, windows: &[RopeWindow], rope: Span) -> Result<(), Problem> {
    let mut left = MAX_WINDOWS;
    for window in windows {
        let (n, length_m) = alarms.windows_of(*window);
        left = left.checked_sub(n).ok_or_else(|| {
            Problem::range_too_large(format!(
                "{:.0} m of rope have {n} windows of {length_m:.3} m, more than the {MAX_WINDOWS} that one answer has in all: set longer windows for the rope",
                rope.length_m()
            ))
            .limit(n, MAX_WINDOWS)
        })?;
    }
    Ok(())
}
