//! Lay lengths of one inspection, stretch by stretch or in buckets.

use super::Problem;
use super::buckets::{self, Bucket, MAX_BUCKETS, buckets};
use super::extract::{Path, Query};
use super::inspections;
use super::problem::ReadProblems;
use super::tables::{CsvTable, Format, wants_csv};
use crate::app::App;
use crate::pipeline::lay_length_table;
use crate::pipeline::quality::Quality;
use crate::pipeline::results::WireEstimate;
use crate::store::Id;
use crate::store::lay_lengths::Stretch;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Lay length of the wires of one strand.
#[derive(Debug, Serialize, ToSchema)]
pub struct WireLay {
    /// Wire lay length in mm against the fixed axes, signed.
    #[schema(required)]
    lay_mm: Option<f64>,
    /// Its standard deviation in mm.
    #[schema(required)]
    lay_sd_mm: Option<f64>,
    /// Phase of wire 0 at the middle line in rad.
    #[schema(required)]
    phase_rad: Option<f64>,
    /// Its standard deviation in rad; null in results from before it was measured.
    #[schema(required)]
    phase_sd_rad: Option<f64>,
    /// Agreement of image and model, 1 is perfect.
    #[schema(required)]
    score: Option<f64>,
    /// Of the lay length; null without one.
    #[schema(required)]
    quality: Option<EstimateQuality>,
}

/// How far an estimate can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EstimateQuality {
    /// A change of 1 % would show at four standard deviations.
    Good,
    /// It would not.
    Uncertain,
}

impl From<Quality> for EstimateQuality {
    fn from(quality: Quality) -> Self {
        match quality {
            Quality::Good => Self::Good,
            Quality::Uncertain => Self::Uncertain,
        }
    }
}

/// Lay lengths of a stretch of rope. What could not be estimated is null, and `reason` says why.
#[derive(Debug, Serialize, ToSchema)]
pub struct LayLength {
    /// The view; null for the estimate fused over all views.
    #[schema(required)]
    view: Option<usize>,
    /// First camera line.
    pub first_line: usize,
    /// Last camera line.
    last_line: usize,
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Rope metre of the middle line.
    position_m: f64,
    /// Strand lay length in mm, signed.
    #[schema(required)]
    strand_lay_mm: Option<f64>,
    /// Its standard deviation in mm.
    #[schema(required)]
    strand_lay_sd_mm: Option<f64>,
    /// Phase of strand 0 at the middle line in rad.
    #[schema(required)]
    strand_phase_rad: Option<f64>,
    /// Its standard deviation in rad.
    #[schema(required)]
    strand_phase_sd_rad: Option<f64>,
    /// Agreement of contours and model, 1 is perfect.
    #[schema(required)]
    strand_score: Option<f64>,
    /// Of the strand lay length; null without one.
    #[schema(required)]
    strand_quality: Option<EstimateQuality>,
    /// Looseness: root mean square of the strands' deviations from their regular places in rad. Fused estimate only.
    #[schema(required)]
    strand_spread_rad: Option<f64>,
    /// Its standard deviation in rad.
    #[schema(required)]
    strand_spread_sd_rad: Option<f64>,
    /// Rope diameter in mm: of a view the distance of its two contours, of all views the mean over the directions. Relative to the nominal
    /// one unless the acquisition's views have `px_per_mm`.
    #[schema(required)]
    diameter_mm: Option<f64>,
    /// Its standard deviation in mm.
    #[schema(required)]
    diameter_sd_mm: Option<f64>,
    /// Of the diameter; null without one.
    #[schema(required)]
    diameter_quality: Option<EstimateQuality>,
    /// Largest less smallest diameter in percent of their mean. Fused estimate only; null where all cameras look in one direction.
    #[schema(required)]
    ovality_percent: Option<f64>,
    /// Its standard deviation in percent of the diameter.
    #[schema(required)]
    ovality_sd_percent: Option<f64>,
    /// One entry a strand.
    wires: Vec<WireLay>,
    /// Why estimates are null; null when none is.
    #[schema(required)]
    reason: Option<String>,
}

/// Lay lengths of an inspection: `rows`, or `buckets` if asked for.
#[derive(Debug, Serialize, ToSchema)]
pub struct LayLengths {
    /// The inspection.
    inspection_id: Uuid,
    /// The view; null for the estimate fused over all views.
    #[schema(required)]
    view: Option<u32>,
    /// Stretch by stretch; null when buckets were asked for.
    #[schema(required)]
    rows: Option<Vec<LayLength>>,
    /// In buckets; null unless asked for.
    #[schema(required)]
    buckets: Option<Vec<Bucket>>,
}

/// Which lay lengths.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct LayLengthQuery {
    /// `fused` (default), or a view.
    #[param(pattern = "^(fused|[0-7])$")]
    view: Option<String>,
    /// Rope metre from which on.
    from_m: Option<f64>,
    /// Rope metre up to which.
    to_m: Option<f64>,
    /// Divide the range into so many buckets.
    #[param(minimum = 1, maximum = 5000)]
    buckets: Option<u32>,
    /// `json` (default) or `csv`; `Accept: text/csv` does too.
    #[param(inline)]
    format: Option<Format>,
}

impl From<Stretch> for LayLength {
    fn from(s: Stretch) -> Self {
        let wire = |w: &WireEstimate| WireLay {
            lay_mm: w.lay_mm,
            lay_sd_mm: w.lay_sd_mm,
            phase_rad: w.phase_rad,
            phase_sd_rad: w.phase_sd_rad,
            score: w.score,
            quality: w.quality().map(Into::into),
        };
        let (strand_quality, diameter_quality) = (s.row.strand_quality(), s.row.diameter_quality());
        Self {
            view: s.row.view,
            first_line: s.row.first_line,
            last_line: s.row.last_line,
            from_m: s.from_m,
            to_m: s.to_m,
            position_m: s.row.position_m,
            strand_lay_mm: s.row.strand_lay_mm,
            strand_lay_sd_mm: s.row.strand_lay_sd_mm,
            strand_phase_rad: s.row.strand_phase_rad,
            strand_phase_sd_rad: s.row.strand_phase_sd_rad,
            strand_score: s.row.strand_score,
            strand_quality: strand_quality.map(Into::into),
            strand_spread_rad: s.row.strand_spread_rad,
            strand_spread_sd_rad: s.row.strand_spread_sd_rad,
            diameter_mm: s.row.diameter_mm,
            diameter_sd_mm: s.row.diameter_sd_mm,
            diameter_quality: diameter_quality.map(Into::into),
            ovality_percent: s.row.ovality_percent,
            ovality_sd_percent: s.row.ovality_sd_percent,
            wires: s.row.wires.iter().map(wire).collect(),
            reason: s.row.reason,
        }
    }
}

/// Reads a range of rope metres; what is not said comes from `span`. Errors: not finite, or empty.
pub fn range_m(from_m: Option<f64>, to_m: Option<f64>, span: Option<(f64, f64)>) -> Result<(f64, f64), Problem> {
    for (name, value) in [("from_m", from_m), ("to_m", to_m)] {
        if let Some(value) = value
            && (!value.is_finite() || value.abs() > 1e7)
        {
            return Err(Problem::outside(name, value, -1e7, 1e7));
        }
    }
    let (first, last) = span.unwrap_or((0.0, 0.0));
    let range = (from_m.unwrap_or(first), to_m.unwrap_or(last));
    match (from_m, to_m) {
        (Some(from), Some(to)) if from >= to => {
            Err(Problem::out_of_range(format!("from_m is {from}, but must be less than to_m, which is {to}"))
                .limit(from, to))
        }
        _ => Ok(range),
    }
}

/// Reads which view is asked for; `None`: fused over all.
pub fn view(text: Option<&str>) -> Result<Option<u32>, Problem> {
    match text {
        None | Some("fused") => Ok(None),
        Some(text) => text.parse().map(Some).map_err(|_| {
            Problem::malformed_query(format!("view is {text:?}, but must be fused or a number")).with("value", text)
        }),
    }
}

/// Refuses numbers of buckets that nobody can draw.
pub fn check_buckets(n: u32) -> Result<u32, Problem> {
    if (1..=MAX_BUCKETS).contains(&n) {
        Ok(n)
    } else {
        Err(Problem::outside("buckets", f64::from(n), 1.0, f64::from(MAX_BUCKETS)))
    }
}

/// Lay lengths along the rope
#[utoipa::path(get, path = "/inspections/{id}/lay-lengths", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection"), LayLengthQuery),
    responses((status = 200, description = "Lay lengths", content((LayLengths = "application/json"), (String = "text/csv"))), ReadProblems))]
pub async fn get_lay_lengths(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<LayLengthQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let inspection = inspections::load(&app, id).await?;
    let view = view(query.view.as_deref())?;
    if let Some(view) = view {
        inspections::check_view(&app, inspection.acquisition_id, view).await?;
    }
    let span = app.store.lay_length_span(Id(id)).await?;
    let (from_m, to_m) = range_m(query.from_m, query.to_m, span)?;
    let n = query.buckets.map(check_buckets).transpose()?;
    let stretches = app.store.lay_lengths(Id(id), view, from_m, to_m).await?;
    let strands = stretches.iter().map(|s| s.row.wires.len()).max().unwrap_or(0);
    let csv = wants_csv(query.format, &headers);
    // An inspection without lay lengths has no range to divide.
    let in_buckets = n.map(|n| if to_m > from_m { buckets(&stretches, from_m, to_m, n, strands) } else { Vec::new() });
    if csv {
        return match in_buckets {
            None => rows_csv(&stretches, strands),
            Some(buckets) => buckets_csv(&buckets, strands),
        };
    }
    let rows = in_buckets.is_none().then(|| stretches.into_iter().map(LayLength::from).collect());
    Ok(axum::Json(LayLengths { inspection_id: id, view, rows, buckets: in_buckets }).into_response())
}

fn buckets_csv(buckets: &[Bucket], strands: usize) -> Result<Response, Problem> {
    let mut table = CsvTable::new(&buckets::columns(strands))?;
    buckets.iter().try_for_each(|bucket| table.row(&buckets::cells(bucket)))?;
    table.finish()
}

/// The columns of `lay_lengths.csv` in a results folder.
fn rows_csv(stretches: &[Stretch], strands: usize) -> Result<Response, Problem> {
    let mut table = CsvTable::new(&lay_length_table::columns(strands))?;
    for Stretch { row, .. } in stretches {
        table.row(&lay_length_table::cells(row, strands, |value, _| value.to_string()))?;
    }
    table.finish()
}
