//! Which frames of an acquisition are not there.

use super::acquisitions::{AcquisitionRow, View, load};
use super::manifest::first_lines;
use super::{Id, Store, StoreError};
use sqlx::SqliteConnection;

/// Most ranges of missing frames that are listed for a view.
pub const MAX_MISSING_RANGES: usize = 1000;

/// Which frames of a view are not there.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingFrames {
    /// The view.
    pub view: u32,
    /// Announced frames; `None` if nobody said how many there will be.
    pub expected: Option<u32>,
    /// Frames that are there.
    pub present: u32,
    /// First and last frame of each gap, at most [`MAX_MISSING_RANGES`].
    pub ranges: Vec<(u32, u32)>,
    /// Rope metres of each gap; `None` where the lines of a frame before its end were never announced.
    pub ranges_m: Vec<Option<(f64, f64)>>,
    /// Frames whose files were found gone or changed, at most [`MAX_MISSING_RANGES`]: to be sent again.
    pub damaged: Vec<u32>,
}

impl MissingFrames {
    /// True when the view has all frames that were announced, and none is damaged.
    pub fn whole(&self) -> bool {
        self.expected == Some(self.present) && self.ranges.is_empty() && self.damaged.is_empty()
    }
}

impl Store {
    /// What is missing in each view. `None` if there is no such acquisition.
    pub async fn missing(&self, id: Id) -> Result<Option<Vec<MissingFrames>>, StoreError> {
        let mut connection = self.reader().acquire().await?;
        match load(&mut connection, id).await? {
            Some(acquisition) => Ok(Some(missing(&mut connection, &acquisition.row, &acquisition.views).await?)),
            None => Ok(None),
        }
    }
}

/// What is missing in these views of an acquisition.
pub(super) async fn missing(
    connection: &mut SqliteConnection,
    acquisition: &AcquisitionRow,
    views: &[View],
) -> Result<Vec<MissingFrames>, StoreError> {
    let id = acquisition.id;
    let position_m = |line: u64| acquisition.start_m + line as f64 * acquisition.line_pitch_mm / 1000.0;
    let mut all = Vec::with_capacity(views.len());
    for view in views {
        let frames: Vec<(u32, bool)> = sqlx::query_as(
            "select frame, damaged_at_ms is not null from frame where acquisition_id = $1 and view = $2 order by frame",
        )
        .bind(id)
        .bind(view.view)
        .fetch_all(&mut *connection)
        .await?;
        let announced: Option<u32> =
            sqlx::query_scalar("select max(frame) + 1 from announced_frame where acquisition_id = $1 and view = $2")
                .bind(id)
                .bind(view.view)
                .fetch_one(&mut *connection)
                .await?;
        let present: Vec<u32> = frames.iter().map(|(frame, _)| *frame).collect();
        let damaged = frames.iter().filter(|(_, damaged)| *damaged).map(|(frame, _)| *frame);
        // A manifest may still grow: it tells gaps, not how many frames there will be.
        let ranges = gaps(&present, view.frames_expected.or(announced));
        let first_lines = if ranges.is_empty() { vec![] } else { first_lines(connection, id, view.view).await? };
        let metres = |&(first, last): &(u32, u32)| {
            Some((position_m(*first_lines.get(first as usize)?), position_m(*first_lines.get(last as usize + 1)?)))
        };
        all.push(MissingFrames {
            view: view.view,
            expected: view.frames_expected,
            present: present.len() as u32,
            ranges_m: ranges.iter().map(metres).collect(),
            ranges,
            damaged: damaged.take(MAX_MISSING_RANGES).collect(),
        });
    }
    Ok(all)
}

/// Gaps in ascending frame numbers, up to the expected count, or up to the last one present.
pub(super) fn gaps(present: &[u32], expected: Option<u32>) -> Vec<(u32, u32)> {
    let mut ranges = Vec::new();
    let mut next = 0;
    for &frame in present {
        if frame > next {
            ranges.push((next, frame - 1));
        }
        next = frame + 1;
    }
    if let Some(expected) = expected
        && expected > next
    {
        ranges.push((next, expected - 1));
    }
    ranges.truncate(MAX_MISSING_RANGES);
    ranges
}

#[cfg(test)]
mod tests {
    use super::gaps;

    #[test]
    fn gaps_are_found_before_between_and_after_frames() {
        assert_eq!(gaps(&[2, 3, 5], Some(9)), [(0, 1), (4, 4), (6, 8)]);
        assert_eq!(gaps(&[], Some(3)), [(0, 2)]);
        assert_eq!(gaps(&[], None), []);
        assert_eq!(gaps(&[0, 1], Some(2)), []);
    }
}
