//! What a training learns from besides its acquisition: read, and checked before a job is queued.

use super::Problem;
use super::acquisitions;
use super::lay_lengths::range_m;
use crate::app::App;
use crate::pipeline::PipelineError;
use crate::pipeline::training_range::{MOST_RANGES, difference, overlap};
use crate::store::Id;
use crate::store::enqueue::{FurtherRange, NewJob, Task};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Intact rope of another acquisition of the same rope, by the same camera head.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FurtherAcquisition {
    /// The complete acquisition.
    acquisition_id: Uuid,
    /// Rope metre from which on the rope is intact, else from the start.
    from_m: Option<f64>,
    /// Rope metre up to which it is, else to the end.
    to_m: Option<f64>,
}

impl From<FurtherRange> for FurtherAcquisition {
    fn from(range: FurtherRange) -> Self {
        Self { acquisition_id: range.acquisition_id.0, from_m: range.from_m, to_m: range.to_m }
    }
}

fn field(number: usize) -> String {
    format!("further_acquisitions[{number}]")
}

/// Reads the list. `first` is the range that stands beside it. Errors: too many, a range that makes no sense, the same rope twice.
pub fn read(first: FurtherRange, list: &[FurtherAcquisition]) -> Result<Vec<FurtherRange>, Problem> {
    if list.len() >= MOST_RANGES {
        let (value, limit) = (list.len(), MOST_RANGES - 1);
        return Err(Problem::out_of_range(format!(
            "further_acquisitions has {value} entries, at most {limit} are taken"
        ))
        .with("field", "further_acquisitions")
        .limit(value, limit));
    }
    let mut all = vec![first];
    for (number, entry) in list.iter().enumerate() {
        range_m(entry.from_m, entry.to_m, None).map_err(|problem| problem.with("field", field(number)))?;
        let range = FurtherRange { acquisition_id: Id(entry.acquisition_id), from_m: entry.from_m, to_m: entry.to_m };
        let shares = |other: &FurtherRange| {
            other.acquisition_id == range.acquisition_id
                && overlap((other.from_m, other.to_m), (range.from_m, range.to_m))
        };
        if all.iter().any(shares) {
            let acquisition = format!("acquisition {}", range.acquisition_id);
            return Err(Problem::ranges_overlap(PipelineError::RangesOverlap { acquisition }.to_string())
                .with("field", field(number))
                .with("value", range.acquisition_id.0));
        }
        all.push(range);
    }
    Ok(all.split_off(1))
}

/// Refuses acquisitions whose frames are gone, or that another camera head has taken. Those that do not exist are left to the store.
pub async fn check(app: &App, new: &NewJob) -> Result<(), Problem> {
    let Task::Train { further, .. } = &new.task else { return Ok(()) };
    let Some(first) = app.store.acquisition(new.acquisition_id).await? else { return Ok(()) };
    let Some(rope) = app.store.rope(first.row.rope_id).await? else { return Ok(()) };
    let checked = |acquisition: &crate::store::acquisitions::Acquisition| {
        acquisition.rope_file(&rope.design).validate().map_err(Problem::failure) // it was checked when it was created
    };
    for (number, range) in further.iter().enumerate() {
        if app.store.acquisition(range.acquisition_id).await?.is_none() {
            continue;
        }
        let other = acquisitions::load_with_frames(app, range.acquisition_id.0).await?;
        if other.row.rope_id != first.row.rope_id {
            continue; // the store says so
        }
        if let Some(difference) = difference(&checked(&first)?, &checked(&other)?) {
            let (value, limit) = (difference.other.clone(), difference.first.clone());
            let acquisition = format!("acquisition {}", range.acquisition_id);
            let differ = PipelineError::AcquisitionsDiffer { acquisition, difference };
            return Err(Problem::acquisitions_differ(differ.to_string())
                .with("field", field(number))
                .limit(value, limit));
        }
    }
    Ok(())
}

/// Which entry an acquisition is, for problems; the one beside the list has a field of its own.
pub fn field_of(new: &NewJob, acquisition: Id) -> String {
    let number = match &new.task {
        Task::Train { further, .. } => further.iter().position(|range| range.acquisition_id == acquisition),
        Task::Inspect { .. } => None,
    };
    match number {
        Some(number) if acquisition != new.acquisition_id => format!("{}.acquisition_id", field(number)),
        _ => "acquisition_id".to_owned(),
    }
}
