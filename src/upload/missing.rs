//! What the service names as missing, and how it is sent.

use super::client::ClientError;
use super::plan::Plan;
use super::progress::Tick;
use super::transfer::{ANNOUNCED_AT_ONCE, Transfer};
use super::upload_error::UploadError;
use serde_json::Value;
use std::ops::RangeInclusive;

/// The frames that an answer names in `missing` (first and last number of each gap) and `damaged`: views and ranges of numbers, which
/// are as long as the service says. It may be any service: they are compared with what the folder has, never written out.
pub(super) fn named(path: &str, answer: &Value) -> Result<Vec<(usize, RangeInclusive<usize>)>, ClientError> {
    let bad = |reason: &str| ClientError::Answer { what: format!("GET {path}"), reason: reason.into() };
    let mut named = Vec::new();
    for entry in answer["views"].as_array().ok_or_else(|| bad("no views"))? {
        let view = entry["view"].as_u64().ok_or_else(|| bad("a view without number"))? as usize;
        for range in entry["missing"].as_array().ok_or_else(|| bad("a view without missing ranges"))? {
            let (Some(from), Some(to)) = (range[0].as_u64(), range[1].as_u64()) else {
                return Err(bad("a range is not two numbers"));
            };
            named.push((view, from as usize..=to as usize));
        }
        let damaged = entry["damaged"].as_array().map(Vec::as_slice).unwrap_or_default();
        named.extend(damaged.iter().filter_map(Value::as_u64).map(|n| (view, n as usize..=n as usize)));
    }
    Ok(named)
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

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn gaps_and_damaged_frames_are_named_and_a_gap_without_end_costs_nothing() {
        let answer = json!({"views": [
            {"view": 0, "missing": [[2, 5], [9, u64::MAX]], "damaged": [7]},
            {"view": 1, "missing": []},
        ]});
        assert_eq!(named("/missing", &answer).unwrap(), [(0, 2..=5), (0, 9..=usize::MAX), (0, 7..=7)]);
        for bad in [json!({}), json!({"views": [{"missing": []}]}), json!({"views": [{"view": 0, "missing": [[1]]}]})] {
            assert!(named("/missing", &bad).is_err(), "{bad}");
        }
    }
}
