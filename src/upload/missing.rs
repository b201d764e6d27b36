//! What the service names as missing, and how it is sent.

use super::client::ClientError;
use super::plan::Plan;
use super::progress::Tick;
use super::transfer::{ANNOUNCED_AT_ONCE, Transfer, UploadError};
use serde_json::Value;

/// The frames of each view that an answer names in `missing` (first and last number of each gap) and `damaged`.
pub(super) fn named(path: &str, answer: &Value) -> Result<Vec<(usize, Vec<usize>)>, ClientError> {
    let bad = |reason: &str| ClientError::Answer { what: format!("GET {path}"), reason: reason.into() };
    let mut views = Vec::new();
    for entry in answer["views"].as_array().ok_or_else(|| bad("no views"))? {
        let view = entry["view"].as_u64().ok_or_else(|| bad("a view without number"))? as usize;
        let mut numbers = Vec::new();
        for range in entry["missing"].as_array().ok_or_else(|| bad("a view without missing ranges"))? {
            let (Some(from), Some(to)) = (range[0].as_u64(), range[1].as_u64()) else {
                return Err(bad("a range is not two numbers"));
            };
            numbers.extend(from as usize..=to as usize);
        }
        let damaged = entry["damaged"].as_array().map(Vec::as_slice).unwrap_or_default();
        numbers.extend(damaged.iter().filter_map(Value::as_u64).map(|n| n as usize));
        views.push((view, numbers));
    }
    Ok(views)
}

impl<F: Fn(&Tick)> Transfer<F> {
    /// Sends what the service names as missing or damaged.
    pub(super) async fn send_missing(&mut self, plan: &Plan) -> Result<(), UploadError> {
        let path = format!("/acquisitions/{}/missing", self.acquisition_id);
        let answer = self.client.get(&path).await?;
        let mut frames = Vec::new();
        for (view, numbers) in named(&path, &answer)? {
            for number in numbers {
                let frame = plan.frames.get(view).and_then(|v| v.get(number));
                let frame = frame.ok_or(UploadError::UnknownFrame { view, frame: number })?;
                frames.push((view, number, frame.clone()));
            }
        }
        for batch in frames.chunks(ANNOUNCED_AT_ONCE) {
            let wanted = self.announce(batch).await?;
            self.send(wanted).await?;
        }
        Ok(())
    }
}
