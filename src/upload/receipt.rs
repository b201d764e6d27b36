//! Waits for the receipt of an upload, after which the originals may be deleted.

use super::plan::Plan;
use super::progress::Tick;
use super::transfer::Transfer;
use super::upload_error::UploadError;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;

/// Wait between two questions.
const ASK_EVERY: Duration = Duration::from_secs(2);

impl<F: Fn(&Tick)> Transfer<F> {
    /// Waits until the service has read every frame back from its disk; sends again what it finds damaged there.
    pub(super) async fn receipt(&mut self, plan: &Plan) -> Result<Value, UploadError> {
        let path = format!("/acquisitions/{}/receipt", self.acquisition_id);
        loop {
            match self.client().post(&path, &json!({})).await {
                Ok(answer) if answer["signature"].is_string() => return Ok(answer),
                Ok(_) => tokio::time::sleep(ASK_EVERY).await,
                Err(error) if error.is_problem("acquisition-incomplete") => self.send_missing(plan).await?,
                Err(error) => return Err(error.into()),
            }
        }
    }
}

/// Writes a receipt so that it is there whole or not at all.
pub fn write(receipt: &Value, to: &Path) -> std::io::Result<()> {
    let folder = to.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    serde_json::to_writer_pretty(&mut file, receipt)?;
    file.as_file().sync_all()?;
    file.persist(to)?;
    Ok(())
}
