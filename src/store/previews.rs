//! Previews: reduced forms of frames that are still to come. Stored as safely as frames, but never taken for frames.

use super::frames::run_blocking;
use super::manifest::first_lines;
use super::missing::{MissingFrames, gaps};
use super::{Id, Store, StoreError, folder};
use std::ops::Range;
use std::path::Path;

/// A preview that is there.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Preview {
    /// The acquisition.
    pub acquisition_id: Id,
    /// The view.
    pub view: u32,
    /// Number of the frame of which it is the reduced form.
    pub frame: u32,
    /// Digest of its bytes, lower-case hex.
    pub sha256: String,
    /// Length of its file.
    pub bytes: i64,
    /// Camera line of the view at which the frame begins.
    pub first_line: i64,
    /// Its lines.
    pub lines: u32,
    /// How soon the frame is wanted; `None`: in its turn.
    pub suspicion: Option<f64>,
    /// Why it is wanted sooner.
    pub reason: Option<String>,
    /// When it was acknowledged, ms since 1970.
    pub received_at_ms: i64,
}

/// What came of a preview that was sent.
#[derive(Debug, Clone, PartialEq)]
pub enum PreviewStored {
    /// It is new, and durable.
    New(Preview),
    /// The same bytes were there already.
    Same(Preview),
    /// Other bytes are there under this number; nothing was changed.
    Different(Preview),
    /// The acquisition takes no previews any more, or is gone; nothing was changed.
    Closed,
}

/// Previews of an acquisition.
#[derive(Debug, Clone, PartialEq)]
pub struct PreviewsThere {
    /// What is there and what is missing of each view.
    pub views: Vec<MissingFrames>,
    /// Bytes of those that are there.
    pub bytes: i64,
    /// The job that looks at them.
    pub job_id: Option<Id>,
}

impl Store {
    /// Camera lines of a frame in its view, if everything up to it is announced or there.
    pub async fn lines_of_frame(
        &self,
        acquisition: Id,
        view: u32,
        frame: u32,
    ) -> Result<Option<Range<u64>>, StoreError> {
        let starts = first_lines(&mut *self.reader().acquire().await?, acquisition, view).await?;
        let at = |n: u32| starts.get(n as usize).copied();
        Ok(at(frame).zip(at(frame + 1)).map(|(from, to)| from..to))
    }

    /// Takes a checked preview into the store: file first, then row. The first one queues the job that looks at them, under the id
    /// `job`; one that was given up because none came is queued again.
    pub async fn keep_preview(&self, upload: &Path, preview: Preview, job: Id) -> Result<PreviewStored, StoreError> {
        let p = &preview;
        let place = self.folder().preview(p.acquisition_id, p.view, p.frame, &p.sha256);
        let (from, to) = (upload.to_owned(), place.clone());
        run_blocking(move || {
            folder::sync_folder(&from)?; // fsync of the file
            folder::move_durably(&from, &to)
        })
        .await?;
        let outcome = self.record_preview(preview, job).await?;
        if matches!(outcome, PreviewStored::Different(_) | PreviewStored::Closed) {
            run_blocking(move || folder::remove(&place)).await?;
        }
        Ok(outcome)
    }

    async fn record_preview(&self, preview: Preview, job: Id) -> Result<PreviewStored, StoreError> {
        let mut tx = self.write().await?;
        let state: Option<String> = sqlx::query_scalar("select state from acquisition where id = $1")
            .bind(preview.acquisition_id)
            .fetch_optional(&mut *tx)
            .await?;
        if state.is_none_or(|state| state != "open") {
            return Ok(PreviewStored::Closed);
        }
        let old: Option<Preview> =
            sqlx::query_as("select * from preview where acquisition_id = $1 and view = $2 and frame = $3")
                .bind(preview.acquisition_id)
                .bind(preview.view)
                .bind(preview.frame)
                .fetch_optional(&mut *tx)
                .await?;
        if let Some(old) = old {
            let same = old.sha256 == preview.sha256;
            return Ok(if same { PreviewStored::Same(old) } else { PreviewStored::Different(old) });
        }
        sqlx::query(
            "insert into preview (acquisition_id, view, frame, sha256, bytes, first_line, lines, received_at_ms)
             values ($1, $2, $3, $4, $5, $6, $7, $8)",
        )
        .bind(preview.acquisition_id)
        .bind(preview.view)
        .bind(preview.frame)
        .bind(&preview.sha256)
        .bind(preview.bytes)
        .bind(preview.first_line)
        .bind(preview.lines)
        .bind(preview.received_at_ms)
        .execute(&mut *tx)
        .await?;
        sqlx::query(
            "insert into job (id, kind, rope_id, acquisition_id, live, preview, state, run_at_ms, created_at_ms)
             select $2, 'inspect', rope_id, id, 1, 1, 'queued', $3, $3 from acquisition where id = $1
             on conflict (acquisition_id) where preview = 1 do update
               set state = 'queued', run_at_ms = $3, attempts = 0, error = null, finished_at_ms = null
               where state = 'failed' and error->>'type' = '/problems/acquisition-abandoned'",
        )
        .bind(preview.acquisition_id)
        .bind(job)
        .bind(preview.received_at_ms)
        .execute(&mut *tx)
        .await?;
        tx.commit().await?;
        self.arrivals.send_replace(());
        Ok(PreviewStored::New(preview))
    }

    /// All previews of an acquisition, view by view along the rope.
    pub async fn previews(&self, acquisition: Id) -> Result<Vec<Preview>, StoreError> {
        Ok(sqlx::query_as("select * from preview where acquisition_id = $1 order by view, frame")
            .bind(acquisition)
            .fetch_all(self.reader())
            .await?)
    }

    /// Previews of a view from frame `from` on without a gap, at most `limit`.
    pub async fn previews_from(
        &self,
        acquisition: Id,
        view: u32,
        from: u32,
        limit: u32,
    ) -> Result<Vec<Preview>, StoreError> {
        let previews: Vec<Preview> = sqlx::query_as(
            "select * from preview where acquisition_id = $1 and view = $2 and frame >= $3 order by frame limit $4",
        )
        .bind(acquisition)
        .bind(view)
        .bind(from)
        .bind(limit)
        .fetch_all(self.reader())
        .await?;
        Ok(previews.into_iter().zip(from..).take_while(|(p, number)| p.frame == *number).map(|(p, _)| p).collect())
    }

    /// How many previews a view will have, if that is known, and how many of all views are there.
    pub async fn previews_arrived(&self, acquisition: Id, view: u32) -> Result<(Option<u32>, i64), StoreError> {
        Ok(sqlx::query_as(
            "select frames_expected, (select count(*) from preview where acquisition_id = $1) from view
             where acquisition_id = $1 and view = $2",
        )
        .bind(acquisition)
        .bind(view)
        .fetch_one(self.reader())
        .await?)
    }

    /// When the last preview of an acquisition was acknowledged, ms since 1970.
    pub async fn last_preview_ms(&self, acquisition: Id) -> Result<Option<i64>, StoreError> {
        Ok(sqlx::query_scalar("select max(received_at_ms) from preview where acquisition_id = $1")
            .bind(acquisition)
            .fetch_one(self.reader())
            .await?)
    }

    /// What is there and what is missing. Numbers of frames come from the acquisition, or else from its manifest.
    pub async fn previews_there(&self, acquisition: Id) -> Result<PreviewsThere, StoreError> {
        let mut connection = self.reader().acquire().await?;
        let expected: Vec<(u32, Option<u32>)> = sqlx::query_as(
            "select v.view, coalesce(v.frames_expected, (select max(n.frame) + 1 from announced_frame n
               where n.acquisition_id = v.acquisition_id and n.view = v.view))
             from view v where v.acquisition_id = $1 order by v.view",
        )
        .bind(acquisition)
        .fetch_all(&mut *connection)
        .await?;
        let previews: Vec<(u32, u32, i64)> =
            sqlx::query_as("select view, frame, bytes from preview where acquisition_id = $1 order by view, frame")
                .bind(acquisition)
                .fetch_all(&mut *connection)
                .await?;
        let job_id = sqlx::query_scalar("select id from job where acquisition_id = $1 and preview = 1")
            .bind(acquisition)
            .fetch_optional(&mut *connection)
            .await?;
        let views = expected.into_iter().map(|(view, expected)| {
            let present: Vec<u32> = previews.iter().filter(|p| p.0 == view).map(|p| p.1).collect();
            let ranges = gaps(&present, expected);
            let ranges_m = vec![None; ranges.len()];
            MissingFrames { view, expected, present: present.len() as u32, ranges, ranges_m, damaged: Vec::new() }
        });
        Ok(PreviewsThere { views: views.collect(), bytes: previews.iter().map(|p| p.2).sum(), job_id })
    }
}
