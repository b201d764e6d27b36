//! Receipts that were given out, and the key that signs them.

use super::frames::run_blocking;
use super::{Id, Store, StoreError, folder};
use crate::signature::SigningKey;
use std::io::Write;
use tempfile::NamedTempFile;

impl Store {
    /// The receipt of an acquisition, as it was given out.
    pub async fn receipt(&self, acquisition: Id) -> Result<Option<String>, StoreError> {
        Ok(sqlx::query_scalar("select body from receipt where acquisition_id = $1")
            .bind(acquisition)
            .fetch_optional(self.reader())
            .await?)
    }

    /// Keeps a receipt. The first one counts, so that two requests do not give out two.
    pub async fn keep_receipt(&self, acquisition: Id, body: &str, now_ms: i64) -> Result<(), StoreError> {
        sqlx::query(
            "insert into receipt (acquisition_id, body, issued_at_ms) values ($1, $2, $3) on conflict do nothing",
        )
        .bind(acquisition)
        .bind(body)
        .bind(now_ms)
        .execute(self.writer())
        .await?;
        Ok(())
    }

    /// The key that signs receipts; made when it is asked for the first time.
    pub async fn signing_key(&self) -> Result<SigningKey, StoreError> {
        let path = self.folder().signing_key();
        run_blocking(move || {
            let failed = |source| StoreError::File { path: path.clone(), source };
            if !path.exists() {
                let parent = path.parent().unwrap_or(&path);
                // Readable by its owner only, as temporary files are; whole before it has its name.
                let mut file = NamedTempFile::new_in(parent).map_err(failed)?;
                file.write_all(&SigningKey::generate().map_err(failed)?).map_err(failed)?;
                file.as_file().sync_all().map_err(failed)?;
                match file.persist_noclobber(&path) {
                    Ok(_) => folder::sync_folder(parent)?,
                    Err(lost) if path.exists() => drop(lost), // another request was first: its key counts
                    Err(lost) => return Err(failed(lost.error)),
                }
            }
            SigningKey::read(&path).map_err(failed)
        })
        .await
    }
}
