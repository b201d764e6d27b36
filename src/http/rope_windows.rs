//! Over which windows of a rope surface alarms are counted, and how many are too many.

use super::Problem;
use super::extract::{Json, Path};
use super::problem::{ReadProblems, WriteProblems};
use super::ropes;
use crate::app::App;
use crate::pipeline::surface_alarms;
use crate::store::Id;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Most windows of a rope.
const MAX_WINDOWS: usize = 20;
/// Shortest and longest window, in its units.
const LENGTH: (f64, f64) = (0.5, 10_000.0);

/// What the length of a window is counted in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum WindowUnit {
    /// Nominal diameters of the rope.
    Diameter,
    /// Lay lengths of the strands: as measured, else as designed.
    Lay,
}

impl From<surface_alarms::WindowUnit> for WindowUnit {
    fn from(unit: surface_alarms::WindowUnit) -> Self {
        match unit {
            surface_alarms::WindowUnit::Diameter => Self::Diameter,
            surface_alarms::WindowUnit::Lay => Self::Lay,
        }
    }
}

impl From<WindowUnit> for surface_alarms::WindowUnit {
    fn from(unit: WindowUnit) -> Self {
        match unit {
            WindowUnit::Diameter => Self::Diameter,
            WindowUnit::Lay => Self::Lay,
        }
    }
}

/// A window of rope, as rules for ropes state it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RopeWindow {
    /// What the length is counted in.
    pub unit: WindowUnit,
    /// Length in these units.
    #[schema(minimum = 0.5, maximum = 10000, example = 6.0)]
    pub length: f64,
    /// More surface alarms in any window of this length are over the limit; null: no limit.
    #[serde(deserialize_with = "Option::deserialize")] // null has to be said
    #[schema(required, maximum = 1_000_000)]
    pub most_surface_alarms: Option<u32>,
}

/// The windows of a rope.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RopeWindows {
    /// The windows; none set means the usual ones, 6, 30, 40 and 500 diameters and one lay, without limits.
    #[schema(max_items = 20)]
    windows: Vec<RopeWindow>,
}

impl From<surface_alarms::RopeWindow> for RopeWindow {
    fn from(w: surface_alarms::RopeWindow) -> Self {
        Self { unit: w.unit.into(), length: w.length, most_surface_alarms: w.most_surface_alarms }
    }
}

impl From<&RopeWindow> for surface_alarms::RopeWindow {
    fn from(w: &RopeWindow) -> Self {
        Self { unit: w.unit.into(), length: w.length, most_surface_alarms: w.most_surface_alarms }
    }
}

async fn load(app: &App, rope: Id) -> Result<RopeWindows, Problem> {
    let windows = app.store.rope_windows(rope).await?;
    Ok(RopeWindows { windows: windows.into_iter().map(RopeWindow::from).collect() })
}

fn check(windows: &[RopeWindow]) -> Result<(), Problem> {
    if windows.len() > MAX_WINDOWS {
        return Err(Problem::outside("windows", windows.len() as f64, 0.0, MAX_WINDOWS as f64));
    }
    for (n, window) in windows.iter().enumerate() {
        if !(LENGTH.0..=LENGTH.1).contains(&window.length) {
            return Err(Problem::outside("length", window.length, LENGTH.0, LENGTH.1));
        }
        if let Some(most) = window.most_surface_alarms.filter(|&most| most > 1_000_000) {
            return Err(Problem::outside("most_surface_alarms", f64::from(most), 0.0, 1e6));
        }
        if windows[..n].iter().any(|w| (w.unit, w.length) == (window.unit, window.length)) {
            return Err(Problem::out_of_range(format!(
                "two windows have the length {} in the unit {}: leave one",
                window.length,
                surface_alarms::WindowUnit::from(window.unit).name()
            ))
            .with("value", window.length));
        }
    }
    Ok(())
}

/// Over which windows surface alarms of a rope are counted
#[utoipa::path(get, path = "/ropes/{id}/windows", tag = "ropes", params(("id" = Uuid, Path, description = "The rope")),
    responses((status = 200, description = "Its windows", body = RopeWindows), ReadProblems))]
pub async fn get_rope_windows(
    State(app): State<App>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<RopeWindows>, Problem> {
    ropes::load(&app, id).await?;
    Ok(axum::Json(load(&app, Id(id)).await?))
}

/// Set over which windows surface alarms of a rope are counted, and how many are too many
#[utoipa::path(put, path = "/ropes/{id}/windows", tag = "ropes", params(("id" = Uuid, Path, description = "The rope")),
    request_body = RopeWindows,
    responses((status = 200, description = "Its windows as they are now", body = RopeWindows), WriteProblems))]
pub async fn put_rope_windows(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<RopeWindows>,
) -> Result<axum::Json<RopeWindows>, Problem> {
    check(&body.windows)?;
    ropes::load(&app, id).await?;
    let windows: Vec<_> = body.windows.iter().map(surface_alarms::RopeWindow::from).collect();
    app.store.set_rope_windows(Id(id), &windows).await?;
    Ok(axum::Json(load(&app, Id(id)).await?))
}
