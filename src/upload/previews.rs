//! Thin links: the previews of all frames first, then the frames in the order in which the service wants them.

use super::entries::{Entry, headers};
use super::missing::named;
use super::packing::Packing;
use super::plan::{Plan, PlanError, PlannedFrame};
use super::progress::Tick;
use super::reducing;
use super::transfer::Transfer;
use super::upload_error::UploadError;
use crate::pipeline::preview::LEAST_SENSOR_PX;
use futures::StreamExt;
use reqwest::Method;
use serde_json::Value;

/// Frames a lane that are sent before the service is asked anew which ones it wants.
const WANTED_A_LANE: usize = 4;

/// A preview that is to be sent.
struct Preview {
    view: usize,
    number: usize,
    /// Camera line at which its frame begins.
    first_line: u64,
    frame: PlannedFrame,
}

impl<F: Fn(&Tick)> Transfer<F> {
    /// Sends the previews that the service does not hold. All frames have been announced.
    pub(super) async fn send_previews(&mut self, plan: &Plan) -> Result<(), UploadError> {
        if plan.sensor_px < LEAST_SENSOR_PX {
            return Err(PlanError::TooNarrow { sensor_px: plan.sensor_px }.into());
        }
        let missing = self.missing_previews(plan).await?;
        self.counter.previews_held(plan.frame_count() - missing.len());
        self.tick();
        let (client, lanes, packing, id) = (self.client.clone(), self.lanes.clone(), self.packing, self.acquisition_id);
        let mut answers = futures::stream::iter(missing)
            .map(|preview| {
                let (client, lanes) = (client.clone(), lanes.clone());
                async move {
                    let _lane = lanes.enter().await;
                    let path = format!("/acquisitions/{id}/views/{}/previews/{}", preview.view, preview.number);
                    let body = bytes::Bytes::from(reduced(packing, preview).await?);
                    let bytes = body.len() as u64;
                    match client.send(Method::PUT, &path, &headers(&body, "image/png"), body).await {
                        Ok(_) => {
                            lanes.succeeded(bytes);
                            Ok(bytes)
                        }
                        // One that another version of this program has sent will do; a complete acquisition needs none.
                        Err(e)
                            if ["frame-differs", "superseded", "acquisition-complete"]
                                .iter()
                                .any(|p| e.is_problem(p)) =>
                        {
                            Ok(0)
                        }
                        Err(error) => Err(UploadError::from(error)),
                    }
                }
            })
            .buffer_unordered(self.connections);
        while let Some(bytes) = answers.next().await {
            self.counter.previewed(bytes?);
            (self.on_tick)(&self.counter.tick(lanes.allowed()));
        }
        Ok(())
    }

    /// Previews that the service does not hold, all views side by side.
    async fn missing_previews(&self, plan: &Plan) -> Result<Vec<Preview>, UploadError> {
        let path = format!("/acquisitions/{}/previews", self.acquisition_id);
        let answer = self.client.get(&path).await?;
        let absent = named(&path, &answer)?;
        let mut missing = Vec::new();
        for (view, frames) in plan.frames.iter().enumerate() {
            let mut first_line = 0;
            for (number, frame) in frames.iter().enumerate() {
                if absent.iter().any(|(v, numbers)| *v == view && numbers.contains(&number)) {
                    missing.push(Preview { view, number, first_line, frame: frame.clone() });
                }
                first_line += u64::from(self.lines.get(&(view, number)).copied().unwrap_or(0));
            }
        }
        missing.sort_by_key(|preview| (preview.number, preview.view));
        Ok(missing)
    }

    /// Takes those of the waiting frames that the service wants most: few enough that what it has seen meanwhile, and what a growing
    /// recording brings, can change the order.
    pub(super) async fn wanted_most(&mut self) -> Result<Vec<Entry>, UploadError> {
        if self.backlog.is_empty() {
            return Ok(Vec::new());
        }
        let at_once = (WANTED_A_LANE * self.connections).min(1000);
        let path = format!("/acquisitions/{}/wanted?limit={at_once}", self.acquisition_id);
        let answer = self.client.get(&path).await?;
        let wanted = answer["frames"].as_array().map(Vec::as_slice).unwrap_or_default();
        let number = |value: &Value| value.as_u64().unwrap_or(u64::MAX) as usize;
        let next: Vec<Entry> =
            wanted.iter().filter_map(|f| self.backlog.remove(&(number(&f["frame"]), number(&f["view"])))).collect();
        if next.is_empty() {
            // Others have brought the rest, or are bringing it.
            return Ok(std::mem::take(&mut self.backlog).into_values().collect());
        }
        Ok(next)
    }
}

/// Reads and reduces a frame, off the async threads.
async fn reduced(packing: Packing, preview: Preview) -> Result<Vec<u8>, UploadError> {
    let path = preview.frame.path;
    let failed = |reason: String| PlanError::Frame { path: path.clone(), reason };
    let source = path.clone();
    let work = tokio::task::spawn_blocking(move || {
        let frame = packing.read(&source)?;
        let unencodable = |e: image::ImageError| PlanError::Frame { path: source.clone(), reason: e.to_string() };
        reducing::encode(&reducing::reduce(&frame, preview.first_line)).map_err(unencodable)
    });
    Ok(work.await.map_err(|e| failed(e.to_string()))??)
}
