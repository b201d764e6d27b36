//! Likelihood maps and images of any range of a view, scaled to what the client can show.

use super::extract::{Path, Query};
use super::frames::{Image, KnownVersion, known};
use super::lines::{LineNumber, line_range, not_empty};
use super::picture::{Strip, Tile, render};
use super::problem::ReadProblems;
use super::{Problem, inspections};
use crate::app::App;
use crate::store::Id;
use axum::extract::{FromRequestParts, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;
use sha2::{Digest, Sha256};
use utoipa::{IntoParams, IntoResponses};
use uuid::Uuid;

/// Longest side of a picture in px.
const MAX_SIDE_PX: u32 = 8192;
/// Most pixels of a picture.
const MAX_PIXELS: u64 = 16 << 20;
/// Most camera lines that one picture is made from: 40 m at 0.1 mm, some seconds of decoding.
const MAX_LINES: u64 = 400_000;
/// Part of every ETag: pictures of another version may look different.
const VERSION: &str = "2";

/// Which part of a view, and how large.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct PictureQuery {
    /// Rope metre from which on; not together with lines.
    from_m: Option<f64>,
    /// Rope metre up to which.
    to_m: Option<f64>,
    /// First camera line, else 0.
    #[param(inline)]
    from_line: Option<LineNumber>,
    /// Line after the last one, else the end of the view.
    #[param(inline)]
    to_line: Option<LineNumber>,
    /// Columns of the picture, at most those of the sensor (then the default): pictures are never enlarged.
    #[param(minimum = 1, maximum = 8192)]
    width: Option<u32>,
    /// Rows of the picture, at most the lines of the range (then the default, as far as limits allow).
    #[param(minimum = 1, maximum = 8192)]
    height: Option<u32>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Scaled down by the least gray: dark is unlikely, and a defect of one pixel must stay visible.
    Likelihood,
    /// Scaled down by the mean.
    Image,
}

/// Which view of which inspection.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Path)]
pub struct ViewPath {
    /// The inspection
    id: Uuid,
    /// The view, from 0
    view: u32,
}

/// A request for a picture, whatever it shall show.
#[derive(FromRequestParts)]
#[from_request(state(App))]
pub struct PictureRequest {
    #[from_request(via(Path))]
    path: ViewPath,
    #[from_request(via(Query))]
    query: PictureQuery,
    headers: HeaderMap,
}

/// What a request for a picture is answered, for the contract.
#[derive(IntoResponses)]
pub enum PictureAnswer {
    /// The picture
    #[response(status = 200, content_type = "image/png", headers(("etag" = String, description = "Version of the picture")))]
    Picture(Image),
    /// The client has it
    #[response(status = 304)]
    Known,
}

/// Likelihood map of a range of a view: rows are camera lines, light is usual, dark is unlikely, black as unlikely as what raises an alarm
/// by the model's own threshold; transparent was not judged (background, hidden by another strand, not covered: the inspection lists that).
/// Scaled down by the darkest pixel, so that small defects stay visible
#[utoipa::path(
    get,
    path = "/inspections/{id}/views/{view}/likelihood.png",
    tag = "inspections",
    params(ViewPath, PictureQuery, KnownVersion),
    responses(PictureAnswer, ReadProblems)
)]
pub async fn get_likelihood(State(app): State<App>, request: PictureRequest) -> Result<Response, Problem> {
    picture(&app, request, Kind::Likelihood).await
}

/// Image of a range of a view, in the geometry of the likelihood map; scaled down by the mean
#[utoipa::path(
    get,
    path = "/inspections/{id}/views/{view}/image.png",
    tag = "inspections",
    params(ViewPath, PictureQuery, KnownVersion),
    responses(PictureAnswer, ReadProblems)
)]
pub async fn get_image(State(app): State<App>, request: PictureRequest) -> Result<Response, Problem> {
    picture(&app, request, Kind::Image).await
}

async fn picture(app: &App, request: PictureRequest, kind: Kind) -> Result<Response, Problem> {
    let PictureRequest { path: ViewPath { id, view }, query, headers } = request;
    let inspection = inspections::load(app, id).await?;
    let acquisition = inspections::check_view(app, inspection.acquisition_id, view).await?;
    if kind == Kind::Likelihood && inspection.model_id.is_none() {
        return Err(Problem::no_likelihood("the inspection was made without a model"));
    }
    if kind == Kind::Image {
        super::acquisitions::load_with_frames(app, inspection.acquisition_id.0).await?;
    }
    let frames = app.store.frames(inspection.acquisition_id, view).await?;
    let lines: u64 = frames.iter().map(|f| u64::from(f.lines)).sum();
    let row = &acquisition.row;
    let line_of = |m: f64| ((m - row.start_m) * 1000.0 / row.line_pitch_mm).round().max(0.0) as u64;
    let (from, to) = range(&query, lines, line_of)?;
    let (width, height) = size(&query, row.sensor_px, to - from)?;
    let name = format!("{VERSION} {id} {view} {} {from} {to} {width} {height}", kind as u8);
    let digest: String = Sha256::digest(name).iter().take(16).map(|b| format!("{b:02x}")).collect();
    let tags = [(header::ETAG, format!("\"{digest}\"")), (header::CACHE_CONTROL, "private, max-age=86400".to_owned())];
    if known(&headers, &tags[0].1) {
        return Ok((StatusCode::NOT_MODIFIED, tags).into_response());
    }
    let mut first_line = 0;
    let mut tiles = Vec::new();
    for frame in &frames {
        let end = first_line + u64::from(frame.lines);
        if end > from && first_line < to {
            let path = match kind {
                Kind::Image => app.store.folder().frame(frame.acquisition_id, view, frame.frame, &frame.sha256),
                Kind::Likelihood => app.store.folder().likelihood_map(Id(id), view, frame.frame),
            };
            tiles.push(Tile { first_line, lines: u64::from(frame.lines), path });
        }
        first_line = end;
    }
    let strip = Strip {
        columns: row.sensor_px as usize,
        from_line: from,
        to_line: to,
        width: width as usize,
        height: height as usize,
        maps: kind == Kind::Likelihood,
    };
    let permit = app.cpu.clone().acquire_owned().await.map_err(Problem::failure)?;
    let shutdown = app.shutdown.clone();
    let png = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        render(&strip, &tiles, || shutdown.is_cancelled())
    });
    let png = png.await.map_err(Problem::failure)?.map_err(Problem::failure)?;
    Ok((tags, [(header::CONTENT_TYPE, "image/png")], png).into_response())
}

/// The lines asked for, cut to those that are there. Errors: nothing left, too many, lines and metres mixed.
fn range(query: &PictureQuery, lines: u64, line_of: impl Fn(f64) -> u64) -> Result<(u64, u64), Problem> {
    super::lay_lengths::range_m(query.from_m, query.to_m, None)?;
    let metres = query.from_m.is_some() || query.to_m.is_some();
    if metres && (query.from_line.is_some() || query.to_line.is_some()) {
        return Err(Problem::malformed_query("the range is given in metres and in lines: one of them is enough"));
    }
    let (from, to) = if metres {
        not_empty(query.from_m.map_or(0, &line_of), query.to_m.map_or(lines, &line_of), lines)?
    } else {
        line_range(query.from_line, query.to_line, lines)?
    };
    if to - from > MAX_LINES {
        return Err(Problem::range_too_large(format!(
            "the range has {} lines, but one picture shows at most {MAX_LINES}",
            to - from
        ))
        .limit(to - from, MAX_LINES));
    }
    Ok((from, to))
}

/// Columns and rows of the picture.
fn size(query: &PictureQuery, sensor_px: u32, lines: u64) -> Result<(u32, u32), Problem> {
    for (name, side) in [("width", query.width), ("height", query.height)] {
        if let Some(side) = side
            && !(1..=MAX_SIDE_PX).contains(&side)
        {
            return Err(Problem::outside(name, f64::from(side), 1.0, f64::from(MAX_SIDE_PX)));
        }
    }
    let width = query.width.unwrap_or(MAX_SIDE_PX).min(sensor_px);
    let most = u64::from(MAX_SIDE_PX).min(lines) as u32;
    let height = match query.height {
        Some(height) => height.min(most),
        None => most.min((MAX_PIXELS / u64::from(width)) as u32),
    };
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MAX_PIXELS {
        return Err(Problem::range_too_large(format!(
            "the picture would have {width}x{height} pixels, but it may have at most {MAX_PIXELS}"
        ))
        .limit(json!({ "width": width, "height": height }), MAX_PIXELS));
    }
    Ok((width, height))
}
