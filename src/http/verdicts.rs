//! Verdicts: people confirm or dismiss defects.

use super::Problem;
use super::auth::Caller;
use super::defect::Defect;
use super::extract::{Json, Path};
use super::problem::WriteProblems;
use super::ropeways::{MAX_NAME, check_text};
use crate::app::App;
use crate::store::Id;
use crate::store::defects::{self, Judged};
use axum::Extension;
use axum::extract::State;
use serde::Deserialize;
use utoipa::ToSchema;
use uuid::Uuid;

/// Longest comment, in characters.
pub const MAX_COMMENT: usize = 4000;

/// What a person decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum VerdictKind {
    /// It is a defect.
    Confirmed,
    /// It is none.
    Dismissed,
}

/// What a person decides about a defect.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewVerdict {
    /// The decision.
    verdict: VerdictKind,
    /// Who decides; else the name of the token.
    #[schema(min_length = 1, max_length = 200)]
    by: Option<String>,
    /// What they say.
    #[schema(max_length = 4000)]
    comment: Option<String>,
}

/// Confirm or dismiss a defect; a confirmation makes its ticket
#[utoipa::path(post, path = "/defects/{id}/verdict", tag = "defects", params(("id" = Uuid, Path, description = "The defect")),
    request_body = NewVerdict,
    responses((status = 200, description = "The defect as it is now", body = Defect), WriteProblems))]
pub async fn post_verdict(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Extension(caller): Extension<Caller>,
    Json(body): Json<NewVerdict>,
) -> Result<axum::Json<Defect>, Problem> {
    if let Some(by) = &body.by {
        check_text("by", by, 1, MAX_NAME)?;
    }
    if let Some(comment) = &body.comment {
        check_text("comment", comment, 0, MAX_COMMENT)?;
    }
    let verdict = defects::Verdict {
        confirmed: body.verdict == VerdictKind::Confirmed,
        by: body.by.unwrap_or(caller.name),
        comment: body.comment,
    };
    match app.store.judge(Id(id), &verdict, app.now_ms()).await? {
        Judged::Accepted(row) => {
            app.outbox_wake.notify_one();
            Ok(axum::Json(row.try_into()?))
        }
        Judged::Contradiction(row) => Err(Problem::verdict_differs(format!(
            "defect {id} was {} by {}; nothing was changed",
            row.state,
            row.verdict_by.as_deref().unwrap_or("somebody")
        ))
        .with("value", &row.state)),
        Judged::Unknown => Err(Problem::no("defect", id)),
    }
}
