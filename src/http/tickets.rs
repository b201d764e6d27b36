//! Tickets: the maintenance system writes back what it made of a defect.

use super::Problem;
use super::defect::Defect;
use super::extract::{Json, Path};
use super::problem::WriteProblems;
use super::ropeways::{MAX_NAME, check_text};
use crate::app::App;
use crate::store::{Id, defects, tickets};
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// A ticket, as the maintenance system knows it.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Ticket {
    /// Its number there.
    #[schema(min_length = 1, max_length = 200)]
    number: String,
    /// Where people see it, http or https.
    #[schema(max_length = 2000)]
    url: Option<String>,
    /// Its state, in the words of that system.
    #[schema(min_length = 1, max_length = 200)]
    state: String,
}

impl Ticket {
    /// The ticket of a defect, if it has one.
    pub fn of(row: &defects::Defect) -> Option<Self> {
        row.ticket_number.clone().map(|number| Self {
            number,
            url: row.ticket_url.clone(),
            state: row.ticket_state.clone().unwrap_or_default(),
        })
    }
}

/// Write back number and state of the ticket
#[utoipa::path(put, path = "/defects/{id}/ticket", tag = "defects", params(("id" = Uuid, Path, description = "The defect")),
    request_body = Ticket,
    responses((status = 200, description = "The defect as it is now", body = Defect), WriteProblems))]
pub async fn put_ticket(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<Ticket>,
) -> Result<axum::Json<Defect>, Problem> {
    check_text("number", &body.number, 1, MAX_NAME)?;
    check_text("state", &body.state, 1, MAX_NAME)?;
    if let Some(url) = &body.url {
        check_text("url", url, 1, 2000)?;
        let web = ["http://", "https://"].iter().any(|scheme| url.starts_with(scheme));
        if !web {
            return Err(Problem::out_of_range(format!("url is {url:?}, but must begin with http:// or https://"))
                .with("field", "url")
                .with("value", url));
        }
    }
    let ticket = tickets::Ticket { number: body.number, url: body.url, state: body.state };
    let row = app.store.set_ticket(Id(id), &ticket).await?.ok_or_else(|| Problem::no("defect", id))?;
    Ok(axum::Json(row.try_into()?))
}
