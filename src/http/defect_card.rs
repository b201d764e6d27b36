//! The card of a defect: one picture that says why it is one. Drawn on request from stored frames, maps and model.

use super::extract::Path;
use super::frames::{KnownVersion, known};
use super::pictures::PictureAnswer;
use super::problem::ReadProblems;
use super::suggestion::DefectKind;
use super::{Problem, acquisitions, defects, inspections, ropes};
use crate::app::App;
use crate::drawing::why_card::{Captions, draw};
use crate::pipeline::closeup::{CloseupError, closeup};
use crate::pipeline::model_file::Model;
use crate::pipeline::results::{AlarmRow, Suggestion};
use crate::pipeline::{self, FrameFiles, PipelineError, Progress, ProgressReport};
use crate::store::defects::Defect;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use std::path::PathBuf;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

/// Part of every ETag: cards of another version may look different.
const VERSION: &str = "1";

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
/// Takes seconds, because the rope around the defect is aligned anew
#[utoipa::path(get, path = "/defects/{id}/card.png", tag = "defects",
    params(("id" = Uuid, Path, description = "The defect"), KnownVersion), responses(PictureAnswer, ReadProblems))]
pub async fn get_defect_card(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let defect = defects::load(&app, id).await?;
    // A verdict changes what the card says, nothing else does.
    let name = format!("{VERSION} {id} {} {:?}", defect.state, defect.verdict_by);
    let digest: String = Sha256::digest(name).iter().take(16).map(|b| format!("{b:02x}")).collect();
    let tags = [(header::ETAG, format!("\"{digest}\"")), (header::CACHE_CONTROL, "private, no-cache".to_owned())];
    if known(&headers, &tags[0].1) {
        return Ok((StatusCode::NOT_MODIFIED, tags).into_response());
    }
    let input = gather(&app, &defect).await?;
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

async fn gather(app: &App, defect: &Defect) -> Result<Input, Problem> {
    let alarms = defect.alarms()?;
    let worst = alarms.iter().max_by(|a, b| a.peak_score.total_cmp(&b.peak_score));
    let alarm = worst.cloned().ok_or_else(|| Problem::no_card("the defect has no alarm to look at"))?;
    let inspection = inspections::load(app, defect.inspection_id.0).await?;
    let model = inspection.model_id.ok_or_else(|| Problem::failure("a defect was found without a model"))?;
    let row = acquisitions::load(app, inspection.acquisition_id.0).await?;
    let rope = ropes::load(app, defect.rope_id.0).await?;
    let view = alarm.view as u32;
    let folder = app.store.folder();
    let maps = app.store.frames(row.row.id, view).await?;
    let maps = maps.iter().map(|frame| folder.likelihood_map(inspection.id, view, frame.frame)).collect();
    Ok(Input {
        captions: captions(
            defect,
            &rope.name,
            &alarms,
            inspection.summary()?.threshold.map(|t| t.line_score),
            defect.suggestion()?,
        ),
        frames: app.store.frame_files(&row).await?,
        maps: FrameFiles::of_maps(row.row.sensor_px, vec![maps]),
        acquisition: row.rope_file(&rope.design).validate().map_err(Problem::failure)?,
        model: folder.model(model),
        alarm,
    })
}

fn captions(
    defect: &Defect,
    rope: &str,
    alarms: &[AlarmRow],
    threshold: Option<f64>,
    suggestion: Option<Suggestion>,
) -> Captions {
    let named = |what: &str, number: Option<u32>| number.map_or(format!("{what} unknown"), |n| format!("{what} {n}"));
    let mut views: Vec<&AlarmRow> = alarms.iter().collect();
    views.sort_by(|a, b| b.peak_score.total_cmp(&a.peak_score));
    let best = views.first().map_or(0, |alarm| alarm.view);
    let mut scores = format!("score {:.1} in view {best}", defect.peak_score);
    if let Some(threshold) = threshold {
        scores += &format!(", alarms begin above {threshold:.1}");
    }
    let others: Vec<_> = views.iter().skip(1).map(|a| format!("{:.1} in view {}", a.peak_score, a.view)).collect();
    if !others.is_empty() {
        scores += &format!("; further alarms: {}", others.join(", "));
    }
    let decision = match (defect.state.as_str(), &defect.verdict_by) {
        ("open", _) => "nobody decided yet".to_owned(),
        (state, Some(by)) => format!("{state} by {by}"),
        (state, None) => state.to_owned(),
    };
    let (from_m, to_m) = (defect.from_m, defect.to_m);
    let angle = defect.angle_deg.map_or(String::new(), |angle| format!(", {angle:.0} degrees round the rope"));
    let likely = suggestion.map(|s| {
        let kind = DefectKind::from(s.kind).name().replace('_', " ");
        format!("likely {kind}: {}; {:.0} mm2 over the threshold", s.why, s.area_mm2)
    });
    Captions {
        title: format!("Surface anomaly {} of {rope}: {decision}", defect.number),
        facts: [
            Some(format!(
                "rope metre {from_m:.4} to {to_m:.4} ({:.1} mm), {}, {}{angle}",
                (to_m - from_m) * 1000.0,
                named("strand", defect.strand),
                named("wire", defect.wire)
            )),
            Some(scores),
            likely,
        ]
        .into_iter()
        .flatten()
        .collect(),
    }
}

fn render(input: &Input, progress: &WhileAskedFor) -> Result<Vec<u8>, Problem> {
    let model = Model::read(&input.model).map_err(Problem::failure)?;
    let seen = closeup(&input.acquisition, &input.frames, &input.maps, &model, &input.alarm, progress);
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
