//! Acquisitions: created, found, deleted.

use super::{Created, Id, Page, PageRequest, Store, StoreError, folder};
use sqlx::SqliteConnection;

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
    /// Calibrated scale in px/mm at the distance of the rope axis, if somebody measured it.
    pub px_per_mm: Option<f64>,
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
    /// Its views in order.
    pub views: Vec<NewView>,
}

/// A view of an acquisition to be created.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewView {
    /// The camera stands where strands of this phase are nearest, in degrees.
    pub angle_deg: f64,
    /// Calibrated scale in px/mm at the distance of the rope axis, if somebody measured it.
    pub px_per_mm: Option<f64>,
    /// How many frames the client announced.
    pub frames: Option<u32>,
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

pub(super) async fn load(connection: &mut SqliteConnection, id: Id) -> Result<Option<Acquisition>, StoreError> {
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
    for (view, new) in old.views.iter().zip(&new.views) {
        let (None, Some(frames)) = (view.frames_expected, new.frames) else { continue };
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
                && old.views.iter().zip(&new.views).all(|(old, new)| {
                    let frames_agree =
                        new.frames.is_none() || old.frames_expected.is_none() || old.frames_expected == new.frames;
                    old.angle_deg == new.angle_deg && old.px_per_mm == new.px_per_mm && frames_agree
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
        for (number, view) in (0_u32..).zip(&new.views) {
            sqlx::query(
                "insert into view (acquisition_id, view, angle_deg, px_per_mm, frames_expected) values ($1, $2, $3, $4, $5)",
            )
            .bind(new.id)
            .bind(number)
            .bind(view.angle_deg)
            .bind(view.px_per_mm)
            .bind(view.frames)
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

    /// Deletes an acquisition and its frames, unless jobs refer to it. The one that looks at its previews goes with them.
    pub async fn delete_acquisition(&self, id: Id) -> Result<Deletion, StoreError> {
        let mut tx = self.write().await?;
        let jobs: i64 = sqlx::query_scalar(
            "select count(*) from job where preview = 0 and id in (select job_id from job_acquisition where acquisition_id = $1)",
        )
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
