//! Consistent copies of a data folder while it is being served. A copy is a data folder itself, so bringing one back is copying it
//! again, and it can also be served where it lies.

use super::frames::run_blocking;
use super::{Id, Store, StoreError, digest, folder};
use std::fs;
use std::path::{Path, PathBuf};

/// Files vanish under a copy when somebody deletes an acquisition; then the database is copied again, at most so often.
const TRIES: u32 = 3;

/// What was copied.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Copied {
    /// Frames, models and inspections that were copied now.
    pub copied: u64,
    /// Those that an earlier backup into the same folder had copied.
    pub held: u64,
    /// Frames whose copy has not the digest that it should have: they were damaged before.
    pub damaged: Vec<PathBuf>,
}

/// A file or folder that a row of the database names; with its digest if it has one.
struct Named {
    from: PathBuf,
    to: PathBuf,
    sha256: Option<String>,
    bytes: Option<i64>,
}

impl Store {
    /// Copies everything that the database of this moment names into the data folder `to`, which may hold an earlier copy.
    /// The database comes last: a copy that was interrupted is the earlier one, and is continued.
    pub async fn copy_to(&self, to: &Path) -> Result<Copied, StoreError> {
        let target = super::DataFolder::open(to)?;
        let mut tries = 0;
        loop {
            tries += 1;
            let snapshot = target.work().join("snapshot.db");
            folder::remove(&snapshot)?;
            sqlx::query("vacuum into $1").bind(snapshot.to_string_lossy()).execute(self.writer()).await?;
            let named = self.named_in(&snapshot, &target).await?;
            let mut copied = Copied::default();
            let mut vanished = None;
            for one in named {
                match run_blocking(move || copy(&one)).await? {
                    Outcome::Copied => copied.copied += 1,
                    Outcome::Held => copied.held += 1,
                    Outcome::Damaged(path) => copied.damaged.push(path),
                    Outcome::Vanished(path) => vanished = Some(path),
                }
            }
            match vanished {
                Some(_) if tries < TRIES => continue,
                // Gone for good: lost, not deleted.
                Some(path) => copied.damaged.push(path),
                None => {}
            }
            let (key, database) = (self.folder().signing_key(), target.database());
            let key_copy = target.signing_key();
            run_blocking(move || {
                if key.is_file() {
                    copy(&Named { from: key, to: key_copy, sha256: None, bytes: None })?;
                }
                folder::sync_folder(&snapshot)?;
                folder::move_durably(&snapshot, &database)
            })
            .await?;
            return Ok(copied);
        }
    }

    /// Everything that lies beside the database and that `snapshot` names.
    async fn named_in(&self, snapshot: &Path, target: &super::DataFolder) -> Result<Vec<Named>, StoreError> {
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(snapshot);
        let rows = sqlx::SqlitePool::connect_with(options).await?;
        // Files that are still arriving are not copied: their clients begin them anew.
        sqlx::query("delete from archive where state in ('receiving', 'unpacking')").execute(&rows).await?;
        // Nor are previews, which only make a choice among frames, nor the jobs that look at them.
        sqlx::query("delete from preview").execute(&rows).await?;
        sqlx::query("delete from job where preview = 1").execute(&rows).await?;
        let frames: Vec<super::frames::Frame> = sqlx::query_as(
            "select f.* from frame f join acquisition a on a.id = f.acquisition_id where a.frames_removed_at_ms is null",
        )
        .fetch_all(&rows)
        .await?;
        let models: Vec<(Id, String, i64)> =
            sqlx::query_as("select id, sha256, bytes from model").fetch_all(&rows).await?;
        let inspections: Vec<Id> = sqlx::query_scalar("select id from inspection").fetch_all(&rows).await?;
        rows.close().await;
        let mut named = Vec::with_capacity(frames.len() + models.len() + inspections.len());
        for f in frames {
            let path = |of: &super::DataFolder| of.frame(f.acquisition_id, f.view, f.frame, &f.sha256);
            let (from, to) = (path(self.folder()), path(target));
            named.push(Named { from, to, bytes: Some(f.bytes), sha256: Some(f.sha256) });
        }
        for (id, sha256, bytes) in models {
            let (from, to) = (self.folder().model(id), target.model(id));
            named.push(Named { from, to, sha256: Some(sha256), bytes: Some(bytes) });
        }
        for id in inspections {
            let (from, to) = (self.folder().inspection(id), target.inspection(id));
            named.push(Named { from, to, sha256: None, bytes: None });
        }
        Ok(named)
    }
}

enum Outcome {
    Copied,
    Held,
    Damaged(PathBuf),
    Vanished(PathBuf),
}

/// Copies one file or folder, durably and whole or not at all. What lies there already was copied whole before: names are never
/// used twice for other content.
fn copy(named: &Named) -> Result<Outcome, StoreError> {
    let held = match named.bytes {
        Some(bytes) => folder::length(&named.to).is_ok_and(|there| there == bytes.unsigned_abs()),
        None => named.to.exists(),
    };
    if held {
        return Ok(Outcome::Held);
    }
    if !named.from.exists() {
        return Ok(Outcome::Vanished(named.from.clone()));
    }
    let mut unfinished = named.to.clone().into_os_string();
    unfinished.push(".unfinished");
    let unfinished = PathBuf::from(unfinished);
    folder::remove(&unfinished)?;
    if let Some(parent) = unfinished.parent() {
        folder::make_folder(parent)?;
    }
    copy_tree(&named.from, &unfinished)?;
    folder::sync_tree(&unfinished)?;
    if let Some(sha256) = &named.sha256
        && digest::of_file(&unfinished)? != *sha256
    {
        folder::remove(&unfinished)?;
        return Ok(Outcome::Damaged(named.from.clone()));
    }
    folder::move_durably(&unfinished, &named.to)?;
    Ok(Outcome::Copied)
}

fn copy_tree(from: &Path, to: &Path) -> Result<(), StoreError> {
    let failed = |source| StoreError::File { path: from.into(), source };
    if !from.is_dir() {
        return fs::copy(from, to).map(drop).map_err(failed);
    }
    folder::make_folder(to)?;
    for entry in folder::entries(from)? {
        let name = entry.file_name().unwrap_or_default();
        copy_tree(&entry, &to.join(name))?;
    }
    Ok(())
}
