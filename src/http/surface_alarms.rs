//! Surface alarms of an inspection, counted over windows of rope as rules for ropes want it.
//!
//! A surface alarm is a defect that nobody dismissed: a place that does not look as intact rope does. It is not a count of
//! broken wires, which only a person at the rope can give.

use super::extract::{Path, Query};
use super::inspections::{self, NotCovered};
use super::problem::ReadProblems;
use super::rope_windows::{self, RopeWindow, WindowUnit};
use super::tables::{CsvTable, FormatQuery, cell, wants_csv};
use super::{Problem, ropes};
use crate::app::App;
use crate::pipeline::results;
use crate::pipeline::windows::{Span, Tally, series, windows_of};
use crate::store::Id;
use crate::store::defects::{ALARM, Defect};
use crate::store::lay_lengths::Stretch;
use crate::store::ropes::Design;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use std::collections::BTreeSet;
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
    window: RopeWindow,
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
    let found = app.store.found_in(Id(id), None).await?;
    // A place to look at again counts as soon as somebody has looked and confirmed it.
    let counts = |d: &&Defect| d.state == "confirmed" || (d.level == ALARM && d.state != "dismissed");
    let spans: Vec<Span> = found.iter().filter(counts).map(|d| Span { from_m: d.from_m, to_m: d.to_m }).collect();
    let counter = Counter { rope, tally: Tally::new(&spans), not_covered: &summary.not_covered };
    let mut left = MAX_WINDOWS;
    let windows = rope_windows::load(&app, inspection.rope_id)
        .await?
        .into_iter()
        .map(|window| counter.windows(window, length(window, &design, &stretches), &mut left))
        .collect::<Result<Vec<_>, _>>()?;
    if wants_csv(query.format, &headers) {
        return csv(&windows);
    }
    let answer = SurfaceAlarms {
        inspection_id: id,
        from_m: rope.from_m,
        to_m: rope.to_m,
        surface_alarms: spans.len(),
        not_covered: summary.not_covered.iter().cloned().map(NotCovered::from).collect(),
        windows,
    };
    Ok(axum::Json(answer).into_response())
}

/// Length of a window in m. Lay lengths are signed; a window is as long as they are.
fn length(window: RopeWindow, design: &Design, stretches: &[Stretch]) -> Option<(f64, LengthOrigin)> {
    let (unit_mm, origin) = match window.unit {
        WindowUnit::Diameter => (design.rope_diameter_mm, LengthOrigin::Designed),
        WindowUnit::Lay => {
            let measured: Vec<f64> = stretches.iter().filter_map(|s| s.row.strand_lay_mm).map(f64::abs).collect();
            if measured.is_empty() {
                (design.strand_lay_mm?.abs(), LengthOrigin::Designed)
            } else {
                (measured.iter().sum::<f64>() / measured.len() as f64, LengthOrigin::Measured)
            }
        }
    };
    Some((window.length * unit_mm / 1000.0, origin))
}

/// What is counted.
struct Counter<'a> {
    rope: Span,
    tally: Tally,
    not_covered: &'a [results::NotCovered],
}

impl Counter<'_> {
    fn windows(
        &self,
        window: RopeWindow,
        length: Option<(f64, LengthOrigin)>,
        left: &mut usize,
    ) -> Result<AlarmWindows, Problem> {
        let Some((length_m, origin)) = length else {
            let reason = "no lay length was measured and the design states none".to_owned();
            let (length_m, length_origin, worst) = (None, None, None);
            return Ok(AlarmWindows {
                window,
                length_m,
                length_origin,
                worst,
                series: Vec::new(),
                reason: Some(reason),
            });
        };
        let n = windows_of(self.rope, length_m);
        *left = left.checked_sub(n).ok_or_else(|| {
            Problem::range_too_large(format!(
                "{:.0} m of rope have {n} windows of {length_m:.3} m, more than the {MAX_WINDOWS} that one answer has in all: set longer windows for the rope",
                self.rope.length_m()
            ))
            .limit(n, MAX_WINDOWS)
        })?;
        Ok(AlarmWindows {
            window,
            length_m: Some(length_m),
            length_origin: Some(origin),
            worst: Some(self.look(self.tally.worst(self.rope, length_m), window)),
            series: series(self.rope, length_m).map(|span| self.look(span, window)).collect(),
            reason: None,
        })
    }

    fn look(&self, span: Span, window: RopeWindow) -> AlarmWindow {
        let surface_alarms = self.tally.count(&span);
        let mut not_covered_view_m = 0.0;
        let mut reasons = BTreeSet::new();
        for gap in self.not_covered {
            let overlap_m = span.overlap_m(&Span { from_m: gap.from_m, to_m: gap.to_m });
            if overlap_m > 0.0 {
                not_covered_view_m += overlap_m;
                reasons.insert(gap.reason.clone());
            }
        }
        AlarmWindow {
            from_m: span.from_m,
            to_m: span.to_m,
            surface_alarms,
            over_limit: window.most_surface_alarms.map(|most| surface_alarms > most as usize),
            not_covered_view_m,
            not_covered_reasons: reasons.into_iter().collect(),
        }
    }
}

fn csv(windows: &[AlarmWindows]) -> Result<Response, Problem> {
    let mut table = CsvTable::new(&[
        "unit",
        "length",
        "length_m",
        "place",
        "from_m",
        "to_m",
        "surface_alarms",
        "most_surface_alarms",
        "over_limit",
        "not_covered_view_m",
        "not_covered_reasons",
    ])?;
    for AlarmWindows { window, length_m, worst, series, .. } in windows {
        let places = worst.iter().map(|w| ("worst", w)).chain(series.iter().map(|w| ("series", w)));
        for (place, found) in places {
            table.row(&[
                window.unit.name().to_owned(),
                window.length.to_string(),
                cell(*length_m),
                place.to_owned(),
                found.from_m.to_string(),
                found.to_m.to_string(),
                found.surface_alarms.to_string(),
                cell(window.most_surface_alarms),
                cell(found.over_limit),
                found.not_covered_view_m.to_string(),
                found.not_covered_reasons.join("; "),
            ])?;
        }
    }
    table.finish()
}
