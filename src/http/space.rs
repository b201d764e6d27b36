//! Room on the disk: looked after before the first byte of an upload and while it arrives, so that jobs and the database never
//! meet a full disk.

use super::Problem;
use crate::app::App;
use crate::store::Id;
use crate::store::quota::Quota;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes on their way in that the disk does not know of yet. Given back when it is dropped.
pub struct Room {
    promised: Arc<AtomicU64>,
    left: u64,
}

impl Room {
    /// Takes room for an upload of `bytes`, if disk and quota have it. Errors: 507 with figures.
    pub async fn take(app: &App, acquisition: Id, bytes: u64) -> Result<Self, Problem> {
        fits_in_quota(app, acquisition, bytes).await?;
        let others = app.promised_bytes.fetch_add(bytes, Ordering::SeqCst);
        let room = Self { promised: Arc::clone(&app.promised_bytes), left: bytes };
        fits_on_disk(app, bytes.saturating_add(others))?;
        Ok(room)
    }

    /// `bytes` went to the disk, which counts them from now on.
    pub fn arrived(&mut self, bytes: u64) {
        let counted = bytes.min(self.left);
        self.left -= counted;
        self.promised.fetch_sub(counted, Ordering::SeqCst);
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        self.promised.fetch_sub(self.left, Ordering::SeqCst);
    }
}

/// Errors when `bytes` more do not fit on the disk beside the head room.
pub fn fits_on_disk(app: &App, bytes: u64) -> Result<(), Problem> {
    let free = app.store.folder().free_bytes()?;
    let reserve = app.settings.limits.reserve_bytes;
    let room = free.saturating_sub(reserve);
    if free >= reserve && bytes <= room {
        return Ok(());
    }
    Err(Problem::insufficient_storage(format!(
        "{bytes} bytes are needed, but the disk of the service has {free} bytes left, of which {reserve} are kept for jobs and \
         the database: free at least {} bytes there, then send the same again",
        bytes.saturating_add(reserve).saturating_sub(free)
    ))
    .limit(bytes, room)
    .with("free_bytes", free)
    .with("reserve_bytes", reserve))
}

/// Errors when `bytes` more of an acquisition exceed the quota of its ropeway.
pub async fn fits_in_quota(app: &App, acquisition: Id, bytes: u64) -> Result<(), Problem> {
    app.store.quota_of(acquisition).await?.map_or(Ok(()), |quota| within_quota(&quota, bytes))
}

/// Errors when `bytes` more exceed a quota.
pub fn within_quota(quota: &Quota, bytes: u64) -> Result<(), Problem> {
    let used = quota.used_bytes.unsigned_abs();
    match quota.quota_bytes.map(i64::unsigned_abs) {
        Some(quota) if used.saturating_add(bytes) > quota => Err(Problem::insufficient_storage(format!(
            "{bytes} bytes are needed, but the ropeway has used {used} bytes of its quota of {quota}: delete acquisitions or \
             raise the quota, then send the same again"
        ))
        .limit(bytes, quota.saturating_sub(used))
        .with("used_bytes", used)
        .with("quota_bytes", quota)),
        _ => Ok(()),
    }
}
