//! Acquisitions: what was announced, what is there, what is missing.

use super::manifest::first_lines;
use super::previews::drop_previews;
use super::{Created, Id, Page, PageRequest, Store, StoreError, folder};
use sqlx::SqliteConnection;

/// Most ranges of missing frames that are listed for a view.
pub const MAX_MISSING_RANGES: usize = 1000;

/// An acquisition without its views.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct AcquisitionRow {
    /// Order of arrival.
    pub seq: i64,
    /// Id.
    pub id: Id,
    /// The rope it shows.
    pub rope_id: Id,
    /// Rope per camera line in mm.
    pub line_pitch_mm: f64,
    /// Columns of every frame.
    pub sensor_px: u32,
    /// Width of the rope in the image in px: a hint.
    pub rope_width_px: Option<f64>,
    /// Rope metre of line 0.
    pub start_m: f64,
    /// When the pass began, ms since 1970.
    pub acquired_at_ms: Option<i64>,
    /// `open` or `complete`.
    pub state: String,
    /// When it was created, ms since 1970.
    pub created_at_ms: i64,
    /// Bytes of the frames that are there.
    pub frame_bytes: i64,
    /// When its frames were removed, ms since 1970; `None` while they are there.
    pub frames_removed_at_ms: Option<i64>,
}

/// A view of an acquisition.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct View {
    /// Number, from 0.
    pub view: u32,
    /// The camera stands where strands of this phase are nearest, in degrees.
    pub angle_deg: f64,
    /// How many frames the client announced.
    pub frames_expected: Option<u32>,
    /// How many frames are there.
    pub frames_present: u32,
}

/// An acquisition.
#[derive(Debug, Clone, PartialEq)]
pub struct Acquisition {
    /// Everything but the views.
    pub row: AcquisitionRow,
    /// Its views in order.
    pub views: Vec<View>,
}

impl Acquisition {
    /// True when no frame will be added any more.
    pub fn complete(&self) -> bool {
        self.row.state == "complete"
    }
}

/// An acquisition to be created.
#[derive(Debug, Clone, PartialEq)]
pub struct NewAcquisition {
    /// Id.
    pub id: Id,
    /// The rope it shows; must exist.
    pub rope_id: Id,
    /// Rope per camera line in mm.
    pub line_pitch_mm: f64,
    /// Columns of every frame.
    pub sensor_px: u32,
    /// Width of the rope in the image in px: a hint.
    pub rope_width_px: Option<f64>,
    /// Rope metre of line 0.
    pub start_m: f64,
    /// When the pass began, ms since 1970.
    pub acquired_at_ms: Option<i64>,
    /// (angle in degrees, announced frames) of each view.
    pub views: Vec<(f64, Option<u32>)>,
}

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

/// What came of the wish to complete an acquisition.
#[derive(Debug, Clone, PartialEq)]
pub enum Completion {
    /// It is complete, now or since an earlier call.
    Complete,
    /// Frames are missing; nothing was changed.
    Missing(Vec<MissingFrames>),
    /// The number of frames contradicts the one announced, or one more frame is there; nothing was changed.
    Contradiction {
        /// The view.
        view: u32,
        /// What the completion says.
        frames: u32,
        /// What was announced, or is there.
        known: u32,
    },
    /// The completion names another number of views than the acquisition has.
    Views {
        /// Views of the acquisition.
        views: usize,
    },
    /// There is no such acquisition.
    Unknown,
}

/// What came of the wish to delete an acquisition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Deletion {
    /// It is gone, with its frames.
    Deleted,
    /// Jobs refer to it; nothing was changed.
    InUse {
        /// How many.
        jobs: i64,
    },
    /// There is no such acquisition.
    Unknown,
}

async fn load(connection: &mut SqliteConnection, id: Id) -> Result<Option<Acquisition>, StoreError> {
    let row =
        sqlx::query_as("select * from acquisition where id = $1").bind(id).fetch_optional(&mut *connection).await?;
    match row {
        Some(row) => Ok(Some(Acquisition { row, views: load_views(connection, id).await? })),
        None => Ok(None),
    }
}

/// Records how many frames the views have where that was not known. False if more are there, or announced, already.
async fn frames_become_known(
    connection: &mut SqliteConnection,
    old: &Acquisition,
    new: &NewAcquisition,
) -> Result<bool, StoreError> {
    for (view, (_, frames)) in old.views.iter().zip(&new.views) {
        let (None, Some(frames)) = (view.frames_expected, frames) else { continue };
        let recorded = sqlx::query(
            "update view set frames_expected = $3 where acquisition_id = $1 and view = $2 and $3 > max(
               coalesce((select max(frame) from frame where acquisition_id = $1 and view = $2), -1),
               coalesce((select max(frame) from announced_frame where acquisition_id = $1 and view = $2), -1))",
        )
        .bind(old.row.id)
        .bind(view.view)
        .bind(frames)
        .execute(&mut *connection)
        .await?;
        if recorded.rows_affected() == 0 {
            return Ok(false);
        }
    }
    Ok(true)
}

async fn load_views(connection: &mut SqliteConnection, id: Id) -> Result<Vec<View>, StoreError> {
    Ok(sqlx::query_as("select * from view where acquisition_id = $1 order by view")
        .bind(id)
        .fetch_all(connection)
        .await?)
}

impl Store {
    /// Creates an acquisition, or finds the one that the same call created before. How many frames a view has may become known later.
    pub async fn create_acquisition(
        &self,
        new: &NewAcquisition,
        now_ms: i64,
    ) -> Result<Created<Acquisition>, StoreError> {
        let mut tx = self.write().await?;
        if let Some(old) = load(&mut tx, new.id).await? {
            let row = &old.row;
            let same = row.rope_id == new.rope_id
                && row.line_pitch_mm == new.line_pitch_mm
                && row.sensor_px == new.sensor_px
                && row.rope_width_px == new.rope_width_px
                && row.start_m == new.start_m
                && row.acquired_at_ms == new.acquired_at_ms
                && old.views.len() == new.views.len()
                && old.views.iter().zip(&new.views).all(|(old, (angle_deg, frames))| {
                    let frames_agree =
                        frames.is_none() || old.frames_expected.is_none() || old.frames_expected == *frames;
                    old.angle_deg == *angle_deg && frames_agree
                });
            if !same || !frames_become_known(&mut tx, &old, new).await? {
                return Ok(Created::Different);
            }
            let views = load_views(&mut tx, new.id).await?;
            tx.commit().await?;
            self.arrivals.send_replace(()); // who waits for the end of the previews
            return Ok(Created::Same(Acquisition { views, ..old }));
        }
        sqlx::query(
            "insert into acquisition (id, rope_id, line_pitch_mm, sensor_px, rope_width_px, start_m, acquired_at_ms, state, created_at_ms)
             values ($1, $2, $3, $4, $5, $6, $7, 'open', $8)",
        )
        .bind(new.id)
        .bind(new.rope_id)
        .bind(new.line_pitch_mm)
        .bind(new.sensor_px)
        .bind(new.rope_width_px)
        .bind(new.start_m)
        .bind(new.acquired_at_ms)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
        for (view, (angle_deg, frames)) in (0_u32..).zip(&new.views) {
            sqlx::query("insert into view (acquisition_id, view, angle_deg, frames_expected) values ($1, $2, $3, $4)")
                .bind(new.id)
                .bind(view)
                .bind(angle_deg)
                .bind(frames)
                .execute(&mut *tx)
                .await?;
        }
        let row = sqlx::query_as("select * from acquisition where id = $1").bind(new.id).fetch_one(&mut *tx).await?;
        let views = load_views(&mut tx, new.id).await?;
        tx.commit().await?;
        Ok(Created::New(Acquisition { row, views }))
    }

    /// An acquisition.
    pub async fn acquisition(&self, id: Id) -> Result<Option<Acquisition>, StoreError> {
        load(&mut *self.reader().acquire().await?, id).await
    }

    /// Acquisitions, of one rope or of all, page by page.
    pub async fn acquisitions(&self, rope: Option<Id>, page: PageRequest) -> Result<Page<Acquisition>, StoreError> {
        let mut connection = self.reader().acquire().await?;
        let rows: Vec<AcquisitionRow> = sqlx::query_as(
            "select * from acquisition where ($1 is null or rope_id = $1) and seq < $2 order by seq desc limit $3",
        )
        .bind(rope)
        .bind(page.before_seq())
        .bind(page.fetch())
        .fetch_all(&mut *connection)
        .await?;
        let mut acquisitions = Vec::with_capacity(rows.len());
        for row in rows {
            let views = load_views(&mut connection, row.id).await?;
            acquisitions.push(Acquisition { row, views });
        }
        Ok(page.page(acquisitions, |a| a.row.seq))
    }

    /// What is missing in each view. `None` if there is no such acquisition.
    pub async fn missing(&self, id: Id) -> Result<Option<Vec<MissingFrames>>, StoreError> {
        let mut connection = self.reader().acquire().await?;
        match load(&mut connection, id).await? {
            Some(acquisition) => Ok(Some(missing(&mut connection, &acquisition.row, &acquisition.views).await?)),
            None => Ok(None),
        }
    }

    /// Closes the acquisition if every view has all its frames. `frames[view]` says how many there are where that was not
    /// announced before. Previews go.
    pub async fn complete_acquisition(
        &self,
        id: Id,
        frames: Option<&[u32]>,
        now_ms: i64,
    ) -> Result<Completion, StoreError> {
        let mut tx = self.write().await?;
        let Some(acquisition) = load(&mut tx, id).await? else { return Ok(Completion::Unknown) };
        let mut views = acquisition.views.clone();
        if let Some(frames) = frames {
            if frames.len() != views.len() {
                return Ok(Completion::Views { views: views.len() });
            }
            for (view, &frames) in views.iter_mut().zip(frames) {
                let known = view.frames_expected.unwrap_or(frames);
                if known != frames {
                    return Ok(Completion::Contradiction { view: view.view, frames, known });
                }
                view.frames_expected = Some(frames);
            }
        }
        let missing = missing(&mut tx, &acquisition.row, &views).await?;
        if let Some(view) = missing.iter().find(|v| v.expected.is_some_and(|expected| v.present > expected)) {
            let frames = view.expected.unwrap_or_default();
            return Ok(Completion::Contradiction { view: view.view, frames, known: view.present });
        }
        if !missing.iter().all(MissingFrames::whole) {
            return Ok(Completion::Missing(missing));
        }
        for view in &views {
            sqlx::query("update view set frames_expected = $3 where acquisition_id = $1 and view = $2")
                .bind(id)
                .bind(view.view)
                .bind(view.frames_expected)
                .execute(&mut *tx)
                .await?;
        }
        sqlx::query("update acquisition set state = 'complete' where id = $1").bind(id).execute(&mut *tx).await?;
        drop_previews(&mut tx, id, now_ms).await?;
        tx.commit().await?;
        self.arrivals.send_replace(());
        self.remove_preview_files(id).await?;
        Ok(Completion::Complete)
    }

    /// Deletes an acquisition and its frames, unless jobs refer to it. The one that looks at its previews goes with them.
    pub async fn delete_acquisition(&self, id: Id) -> Result<Deletion, StoreError> {
        let mut tx = self.write().await?;
        let jobs: i64 = sqlx::query_scalar("select count(*) from job where acquisition_id = $1 and preview = 0")
            .bind(id)
            .fetch_one(&mut *tx)
            .await?;
        if jobs > 0 {
            return Ok(Deletion::InUse { jobs });
        }
        sqlx::query("delete from job where acquisition_id = $1 and preview = 1").bind(id).execute(&mut *tx).await?;
        let deleted =
            sqlx::query("delete from acquisition where id = $1").bind(id).execute(&mut *tx).await?.rows_affected();
        tx.commit().await?;
        if deleted == 0 {
            return Ok(Deletion::Unknown);
        }
        // Rows first: files without rows are swept at the next start, rows without files would be a lie.
        folder::remove(&self.folder().acquisition(id))?;
        self.remove_preview_files(id).await?;
        Ok(Deletion::Deleted)
    }
}

async fn missing(
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
