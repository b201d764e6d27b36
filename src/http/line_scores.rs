//! Line scores of one view, greatest per bucket: a defect of one line must not drown in a mean.

use super::extract::{Path, Query};
use super::lines::{LineNumber, line_range};
use super::problem::ReadProblems;
use super::{Problem, inspections};
use crate::app::App;
use crate::store::Id;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use std::io::{Read, Seek, SeekFrom};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Most buckets of a request.
const MAX_BUCKETS: u32 = 10_000;
/// Buckets unless asked otherwise.
const DEFAULT_BUCKETS: u32 = 1000;

/// Greatest line score of some lines.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct ScoreBucket {
    /// First line.
    first_line: u64,
    /// Last line.
    last_line: u64,
    /// Greatest score; null where no line was inspected.
    #[schema(required)]
    max: Option<f32>,
    /// Lines that were not inspected.
    lines_not_inspected: u64,
}

/// Line scores of a view. Higher is more anomalous; comparable over frames, views and runs of one model.
#[derive(Debug, Serialize, ToSchema)]
pub struct LineScores {
    /// The inspection.
    inspection_id: Uuid,
    /// The view.
    view: u32,
    /// Lines of the view.
    lines: u64,
    /// The range asked for, in buckets of (nearly) equal length.
    buckets: Vec<ScoreBucket>,
}

/// Which line scores.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct LineScoreQuery {
    /// The view.
    #[param(minimum = 0, maximum = 7)]
    view: u32,
    /// First line, else 0.
    #[param(inline)]
    from_line: Option<LineNumber>,
    /// Line after the last one, else the end.
    #[param(inline)]
    to_line: Option<LineNumber>,
    /// Number of buckets, else 1000; never more than lines.
    #[param(minimum = 1, maximum = 10000)]
    buckets: Option<u32>,
}

/// Line scores of one view
#[utoipa::path(get, path = "/inspections/{id}/line-scores", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection"), LineScoreQuery),
    responses((status = 200, description = "Line scores", body = LineScores), ReadProblems))]
pub async fn get_line_scores(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<LineScoreQuery>,
) -> Result<axum::Json<LineScores>, Problem> {
    let inspection = inspections::load(&app, id).await?;
    let view = query.view;
    inspections::check_view(&app, inspection.acquisition_id, view).await?;
    let n = query.buckets.unwrap_or(DEFAULT_BUCKETS);
    if !(1..=MAX_BUCKETS).contains(&n) {
        return Err(Problem::outside("buckets", f64::from(n), 1.0, f64::from(MAX_BUCKETS)));
    }
    let path = app.store.folder().line_scores(Id(id), view);
    let read = tokio::task::spawn_blocking(move || -> Result<_, Problem> {
        let mut file = match std::fs::File::open(&path) {
            Ok(file) => file,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Err(Problem::no_likelihood("the inspection was made without a model, so lines have no scores"));
            }
            Err(e) => return Err(Problem::failure(format!("{}: {e}", path.display()))),
        };
        let lines = file.metadata().map_err(Problem::failure)?.len() / 4;
        let (from, to) = line_range(query.from_line, query.to_line, lines)?;
        file.seek(SeekFrom::Start(from * 4)).map_err(Problem::failure)?;
        let mut reader = std::io::BufReader::with_capacity(1 << 18, file);
        let buckets = u64::from(n).min(to - from);
        let mut found = Vec::with_capacity(buckets as usize);
        for i in 0..buckets {
            let edge = |i: u64| from + i * (to - from) / buckets;
            found.push(bucket(&mut reader, edge(i), edge(i + 1)).map_err(Problem::failure)?);
        }
        Ok((lines, found))
    });
    let (lines, buckets) = read.await.map_err(Problem::failure)??;
    Ok(axum::Json(LineScores { inspection_id: id, view, lines, buckets }))
}

/// Reads the lines `[from, to)` at which the reader stands. NaN is a line that was not inspected.
fn bucket(reader: &mut impl Read, from: u64, to: u64) -> std::io::Result<ScoreBucket> {
    let mut max: Option<f32> = None;
    let mut lines_not_inspected = 0;
    for _ in from..to {
        let mut bytes = [0; 4];
        reader.read_exact(&mut bytes)?;
        let score = f32::from_le_bytes(bytes);
        if score.is_finite() {
            max = Some(max.map_or(score, |m| m.max(score)));
        } else {
            lines_not_inspected += 1;
        }
    }
    Ok(ScoreBucket { first_line: from, last_line: to - 1, max, lines_not_inspected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_keeps_the_greatest_score_and_counts_lines_without() {
        let bytes: Vec<u8> = [1.0_f32, f32::NAN, 5.0, 2.0].iter().flat_map(|s| s.to_le_bytes()).collect();
        let mut reader = &bytes[..];
        let found = bucket(&mut reader, 10, 14).unwrap();
        assert_eq!(found, ScoreBucket { first_line: 10, last_line: 13, max: Some(5.0), lines_not_inspected: 1 });
    }
}
