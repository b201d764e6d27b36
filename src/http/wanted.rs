//! In which order the service wants the frames that it does not have.

use super::extract::{Path, Query};
use super::problem::ReadProblems;
use super::{Problem, acquisitions};
use crate::app::App;
use crate::store::Id;
use crate::store::wanted::Wanted;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Most frames of one answer.
const MOST: u32 = 1000;
/// Frames of an answer when nobody says how many.
const USUAL: u32 = 100;

/// How many frames.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct WantedQuery {
    /// Most frames of the answer, else 100.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
}

/// A frame that is wanted.
#[derive(Debug, Serialize, ToSchema)]
pub struct WantedFrame {
    /// The view.
    view: u32,
    /// Number within the view.
    frame: u32,
    /// Rope metre where it begins; null without a preview.
    #[schema(required)]
    from_m: Option<f64>,
    /// Rope metre where it ends.
    #[schema(required)]
    to_m: Option<f64>,
    /// How soon it is wanted, higher is sooner: 1 is a score at the threshold, or a lay length at its limit. Null: in its turn.
    #[schema(required)]
    suspicion: Option<f64>,
    /// Why it is wanted sooner.
    #[schema(required)]
    reason: Option<String>,
}

/// Frames in the order in which they are wanted.
#[derive(Debug, Serialize, ToSchema)]
pub struct WantedFrames {
    /// The frames. Ask again after a while: the order changes when previews were looked at.
    frames: Vec<WantedFrame>,
}

/// Announced frames that are not there, in the order in which they are wanted: suspicious metres first, the rest along the rope
#[utoipa::path(get, path = "/acquisitions/{id}/wanted", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition"), WantedQuery),
    responses((status = 200, description = "Frames in the order in which they are wanted", body = WantedFrames), ReadProblems))]
pub async fn get_wanted(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<WantedQuery>,
) -> Result<axum::Json<WantedFrames>, Problem> {
    let limit = query.limit.unwrap_or(USUAL);
    if !(1..=MOST).contains(&limit) {
        return Err(Problem::outside("limit", f64::from(limit), 1.0, f64::from(MOST)));
    }
    let acquisition = acquisitions::load(&app, id).await?.row;
    let position_m = |line: i64| acquisition.start_m + line as f64 * acquisition.line_pitch_mm / 1000.0;
    let frames = app.store.wanted(Id(id), limit).await?.into_iter().map(|w: Wanted| WantedFrame {
        view: w.view,
        frame: w.frame,
        from_m: w.first_line.map(position_m),
        to_m: w.first_line.map(|line| position_m(line + i64::from(w.lines))),
        suspicion: w.suspicion,
        reason: w.reason,
    });
    Ok(axum::Json(WantedFrames { frames: frames.collect() }))
}
