//! Deliveries of events to webhook endpoints, with every attempt.

use super::extract::{Path, Query};
use super::pages::next_cursor;
use super::problem::{ReadProblems, WriteProblems};
use super::{Problem, pages, times};
use crate::app::App;
use crate::store::Id;
use crate::store::deliveries::{self, Redelivery};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Where a delivery stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum DeliveryState {
    /// It will be tried (again).
    Pending,
    /// The receiver has it.
    Delivered,
    /// Given up; ask for a redelivery once the receiver works.
    Dead,
}

impl DeliveryState {
    fn name(self) -> &'static str {
        match self {
            Self::Pending => "pending",
            Self::Delivered => "delivered",
            Self::Dead => "dead",
        }
    }
}

/// One attempt.
#[derive(Debug, Serialize, ToSchema)]
pub struct DeliveryAttempt {
    /// 1, 2, ...
    number: i64,
    /// When it began.
    #[schema(format = DateTime)]
    started_at: String,
    /// How long it took in ms.
    duration_ms: i64,
    /// HTTP status; null when there was no answer.
    #[schema(required)]
    status: Option<i64>,
    /// What went wrong; null when it was accepted.
    #[schema(required)]
    error: Option<String>,
}

impl From<deliveries::Attempt> for DeliveryAttempt {
    fn from(row: deliveries::Attempt) -> Self {
        Self {
            number: row.number,
            started_at: times::rfc3339(row.started_at_ms),
            duration_ms: row.duration_ms,
            status: row.status,
            error: row.error,
        }
    }
}

/// One event on its way to one endpoint.
#[derive(Debug, Serialize, ToSchema)]
pub struct Delivery {
    /// Id.
    id: Uuid,
    /// `webhook-id` of the event, the same in every attempt.
    event_id: String,
    /// The defect that it is about.
    defect_id: Uuid,
    /// The receiver.
    endpoint_id: Uuid,
    /// `pending`, `delivered` or `dead`.
    state: String,
    /// When it will be tried next; null unless it is pending.
    #[schema(required, format = DateTime)]
    next_attempt_at: Option<String>,
    /// When it was made.
    #[schema(format = DateTime)]
    created_at: String,
    /// When it was delivered or given up; null while it is pending.
    #[schema(required, format = DateTime)]
    settled_at: Option<String>,
    /// Every attempt, oldest first.
    attempts: Vec<DeliveryAttempt>,
}

/// A page of deliveries.
#[derive(Debug, Serialize, ToSchema)]
pub struct DeliveryPage {
    /// The items.
    items: Vec<Delivery>,
    /// Pass it as `cursor` to get the next page; null on the last one.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// Which deliveries.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct DeliveryQuery {
    /// Only those in this state.
    #[param(inline)]
    state: Option<DeliveryState>,
    /// `next_cursor` of the page before.
    cursor: Option<String>,
    /// Items per page.
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: Option<u32>,
}

async fn view(app: &App, row: deliveries::Delivery) -> Result<Delivery, Problem> {
    let attempts = app.store.attempts(row.id).await?.into_iter().map(DeliveryAttempt::from).collect();
    let pending = row.state == DeliveryState::Pending.name();
    Ok(Delivery {
        id: row.id.0,
        event_id: row.event_id,
        defect_id: row.defect_id.0,
        endpoint_id: row.endpoint_id.0,
        state: row.state,
        next_attempt_at: pending.then(|| times::rfc3339(row.next_attempt_at_ms)),
        created_at: times::rfc3339(row.created_at_ms),
        settled_at: row.settled_at_ms.map(times::rfc3339),
        attempts,
    })
}

/// All deliveries, newest first
#[utoipa::path(get, path = "/deliveries", tag = "ticketing", params(DeliveryQuery),
    responses((status = 200, description = "A page of deliveries", body = DeliveryPage), ReadProblems))]
pub async fn list_deliveries(
    State(app): State<App>,
    Query(query): Query<DeliveryQuery>,
) -> Result<axum::Json<DeliveryPage>, Problem> {
    let page = pages::PageQuery { cursor: query.cursor, limit: query.limit }.request()?;
    let page = app.store.deliveries(query.state.map(DeliveryState::name), page).await?;
    let next_cursor = next_cursor(&page);
    let mut items = Vec::with_capacity(page.items.len());
    for row in page.items {
        items.push(view(&app, row).await?);
    }
    Ok(axum::Json(DeliveryPage { items, next_cursor }))
}

/// A delivery
#[utoipa::path(get, path = "/deliveries/{id}", tag = "ticketing", params(("id" = Uuid, Path, description = "The delivery")),
    responses((status = 200, description = "The delivery", body = Delivery), ReadProblems))]
pub async fn get_delivery(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Delivery>, Problem> {
    let row = app.store.delivery(Id(id)).await?.ok_or_else(|| Problem::no("delivery", id))?;
    Ok(axum::Json(view(&app, row).await?))
}

/// Send an event to its endpoint again, from the start of the schedule, under the same `webhook-id`
#[utoipa::path(post, path = "/deliveries/{id}/redelivery", tag = "ticketing", params(("id" = Uuid, Path, description = "The delivery")),
    responses(
    (status = 202, description = "It will be sent again", body = Delivery, headers(("location" = String, description = "The delivery"))),
    WriteProblems))]
pub async fn redeliver(State(app): State<App>, Path(id): Path<Uuid>) -> Result<Response, Problem> {
    match app.store.redeliver(Id(id), app.now_ms()).await? {
        Redelivery::Absent => Err(Problem::no("delivery", id)),
        Redelivery::EndpointDisabled => Err(Problem::endpoint_disabled(format!(
            "the endpoint of delivery {id} is switched off: switch it on first (PATCH /webhook-endpoints/{{id}})"
        ))),
        Redelivery::Queued(row) => {
            app.outbox_wake.notify_one();
            let address = format!("/api/v1/deliveries/{id}");
            Ok((StatusCode::ACCEPTED, [(header::LOCATION, address)], axum::Json(view(&app, row).await?))
                .into_response())
        }
    }
}
