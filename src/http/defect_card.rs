//! The card of a defect: one picture that says why it is one. Drawn on request from stored frames, maps and model.

use super::extract::Path;
use super::frames::{KnownVersion, known};
use super::pictures::PictureAnswer;
use super::problem::ReadProblems;
use super::{Problem, acquisitions, defects, inspections, ropes};
use crate::app::App;
use crate::drawing::captions::Captions;
use crate::drawing::why_card::draw;
use crate::pipeline::closeup::{CloseupError, closeup};
use crate::pipeline::model_file::Model;
use crate::pipeline::results::AlarmRow;
use crate::pipeline::{self, FrameFiles, PipelineError, Progress, ProgressReport};
use crate::store::defects::Defect;
use crate::store::inspections::Inspection;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use std::path::PathBuf;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

/// Part of every ETag: cards of another version may look different.
const VERSION: &str = "2";

/// What a card is drawn from.
struct Input {
    acquisition: pipeline::Acquisition,
    frames: FrameFiles,
    maps: FrameFiles,
    model: PathBuf,
    alarm: AlarmRow,
    captions: Captions,
}

/// Stops when nobody waits for the card any more.
struct WhileAskedFor(CancellationToken);

impl Progress for WhileAskedFor {
    fn report(&self, _report: ProgressReport) {}

    fn cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// Why a defect is one, on one sheet: image, likelihood, intact rope as the model draws it, gray values observed and expected.
/// Takes seconds, because the rope around the defect is aligned anew; 410 when retention has removed its frames
#[utoipa::path(get, path = "/defects/{id}/card.png", tag = "defects",
    params(("id" = Uuid, Path, description = "The defect"), KnownVersion), responses(PictureAnswer, ReadProblems))]
pub async fn get_defect_card(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let defect = defects::load(&app, id).await?;
    let inspection = inspections::load(&app, defect.inspection_id.0).await?;
    let threshold = inspection.summary()?.threshold.map(|t| t.line_score);
    // A verdict and another threshold change what the card says, nothing else does.
    let name = format!("{VERSION} {id} {} {:?} {threshold:?}", defect.state, defect.verdict_by);
    let digest: String = Sha256::digest(name).iter().take(16).map(|b| format!("{b:02x}")).collect();
    let tags = [(header::ETAG, format!("\"{digest}\"")), (header::CACHE_CONTROL, "private, no-cache".to_owned())];
    if known(&headers, &tags[0].1) {
        return Ok((StatusCode::NOT_MODIFIED, tags).into_response());
    }
    let input = gather(&app, &defect, &inspection, threshold).await?;
    let permit = app.cpu.clone().acquire_owned().await.map_err(Problem::failure)?;
    let asked_for = app.shutdown.child_token();
    let _until_answered = asked_for.clone().drop_guard();
    let card = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        render(&input, &WhileAskedFor(asked_for))
    });
    let png = card.await.map_err(Problem::failure)??;
    Ok((tags, [(header::CONTENT_TYPE, "image/png")], png).into_response())
}

async fn gather(app: &App, defect: &Defect, inspection: &Inspection, threshold: Option<f64>) -> Result<Input, Problem> {
    let row_of_defect = defect.row()?;
    let alarm = row_of_defect.worst().cloned().ok_or_else(|| Problem::no_card("the defect has no alarm to look at"))?;
    let model = inspection.model_id.ok_or_else(|| Problem::failure("a defect was found without a model"))?;
    let row = acquisitions::load_with_frames(app, inspection.acquisition_id.0).await?;
    let rope = ropes::load(app, defect.rope_id.0).await?;
    let view = alarm.view as u32;
    let folder = app.store.folder();
    let maps = app.store.frames(row.row.id, view).await?;
    let maps = maps.iter().map(|frame| folder.likelihood_map(inspection.id, view, frame.frame)).collect();
    Ok(Input {
        captions: Captions::of(&row_of_defect, &rope.name, &decision(defect), threshold),
        frames: app.store.frame_files(&row).await?,
        maps: FrameFiles::of_maps(row.row.sensor_px, vec![maps]),
        acquisition: row.rope_file(&rope.design).validate().map_err(Problem::failure)?,
        model: folder.model(model),
        alarm,
    })
}

fn decision(defect: &Defect) -> String {
    match (defect.state.as_str(), &defect.verdict_by) {
        ("open", _) => "nobody decided yet".to_owned(),
        (state, Some(by)) => format!("{state} by {by}"),
        (state, None) => state.to_owned(),
    }
}

fn render(input: &Input, progress: &WhileAskedFor) -> Result<Vec<u8>, Problem> {
    let model = Model::read(&input.model).map_err(Problem::failure)?;
    let seen = closeup(&input.acquisition, &input.frames, &input.maps, &model, &input.alarm, None, progress);
    let seen = seen.map_err(|error| match error {
        CloseupError::NotAligned(_) => Problem::no_card(error.to_string()),
        CloseupError::Pipeline(PipelineError::Cancelled) => Problem::busy("the service goes down"),
        CloseupError::Pipeline(error) => Problem::failure(error),
    })?;
    let mut png = std::io::Cursor::new(Vec::new());
    let card = draw(&input.captions, &seen, &input.alarm);
    card.write_to(&mut png, image::ImageFormat::Png).map_err(Problem::failure)?;
    Ok(png.into_inner())
}
