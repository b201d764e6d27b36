//! Webhook endpoints: who is told about defects.

use super::extract::{Json, Path, Query};
use super::pages::{PageQuery, page_of};
use super::problem::{ReadProblems, WriteProblems};
use super::{Problem, times};
use crate::app::App;
use crate::store::webhook_endpoints::{Endpoint, NewEndpoint};
use crate::store::{Id, StoreError};
use crate::ticketing::{guard, send};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use rand::TryRngCore;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Longest URL of an endpoint, in characters.
const MAX_URL: usize = 2000;

/// A receiver of events.
#[derive(Debug, Serialize, ToSchema)]
pub struct WebhookEndpoint {
    /// Id.
    id: Uuid,
    /// Where events are posted to.
    url: String,
    /// Secret that signs the events (Standard Webhooks); only in the answer that made the endpoint.
    #[serde(skip_serializing_if = "Option::is_none")]
    secret: Option<String>,
    /// May its address be in a private network?
    allow_private: bool,
    /// Are events sent to it?
    enabled: bool,
    /// Why it was switched off; null while it is on.
    #[schema(required)]
    disabled_reason: Option<String>,
    /// When it was made.
    #[schema(format = DateTime)]
    created_at: String,
}

impl From<Endpoint> for WebhookEndpoint {
    fn from(row: Endpoint) -> Self {
        Self {
            id: row.id.0,
            url: row.url,
            secret: None,
            allow_private: row.allow_private,
            enabled: row.enabled,
            disabled_reason: row.disabled_reason,
            created_at: times::rfc3339(row.created_at_ms),
        }
    }
}

page_of!(
    /// A page of webhook endpoints.
    WebhookEndpointPage, WebhookEndpoint, Endpoint
);

/// An endpoint to be made.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewWebhookEndpoint {
    /// Id, if the client chooses it.
    id: Option<Uuid>,
    /// Where events are posted to: http or https, without user name and password.
    #[schema(min_length = 1, max_length = 2000, example = "https://maintenance.example/hooks/ropescope")]
    url: String,
    /// May its address be in a private network? Needed for receivers on the operator's own machines.
    #[serde(default)]
    allow_private: bool,
}

/// What changes about an endpoint.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookEndpointChange {
    /// Shall events be sent to it? False lets its pending deliveries die.
    enabled: bool,
}

/// Make an endpoint; the answer is the only one that shows its secret
#[utoipa::path(post, path = "/webhook-endpoints", tag = "ticketing", request_body = NewWebhookEndpoint, responses(
    (status = 201, description = "It was made", body = WebhookEndpoint, headers(("location" = String, description = "Its address"))),
    (status = 200, description = "It was there with the same content", body = WebhookEndpoint),
    WriteProblems))]
pub async fn create_endpoint(
    State(app): State<App>,
    Json(body): Json<NewWebhookEndpoint>,
) -> Result<Response, Problem> {
    super::ropeways::check_text("url", &body.url, 1, MAX_URL)?;
    guard::parse(&body.url).map_err(|e| Problem::out_of_range(e.to_string()).with("field", "url"))?;
    let mut random = [0_u8; 32];
    rand::rngs::OsRng.try_fill_bytes(&mut random).map_err(Problem::failure)?;
    let id = body.id.map_or_else(|| app.new_id(), Id);
    let new = NewEndpoint {
        id,
        url: body.url,
        secret: send::secret(random),
        allow_private: body.allow_private,
        enabled: true,
    };
    let address = format!("/api/v1/webhook-endpoints/{id}");
    if let Some(row) = app.store.add_endpoint(&new, app.now_ms()).await? {
        app.outbox_wake.notify_one(); // it may have been given events that waited for somebody
        let view = WebhookEndpoint { secret: Some(new.secret), ..row.into() };
        return Ok((StatusCode::CREATED, [(header::LOCATION, address)], axum::Json(view)).into_response());
    }
    let row = find(&app, id.0).await?;
    if row.url != new.url || row.allow_private != new.allow_private {
        return Err(Problem::id_in_use(format!("{address} exists with other content; nothing was changed")));
    }
    Ok((StatusCode::OK, [(header::LOCATION, address)], axum::Json(WebhookEndpoint::from(row))).into_response())
}

async fn find(app: &App, id: Uuid) -> Result<Endpoint, Problem> {
    let row: Result<_, StoreError> = app.store.endpoint(Id(id)).await;
    row?.ok_or_else(|| Problem::no("webhook endpoint", id))
}

/// All endpoints, newest first, without their secrets
#[utoipa::path(get, path = "/webhook-endpoints", tag = "ticketing", params(PageQuery),
    responses((status = 200, description = "A page of endpoints", body = WebhookEndpointPage), ReadProblems))]
pub async fn list_endpoints(
    State(app): State<App>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<WebhookEndpointPage>, Problem> {
    Ok(axum::Json(app.store.endpoints(page.request()?).await?.try_into()?))
}

/// An endpoint, without its secret
#[utoipa::path(get, path = "/webhook-endpoints/{id}", tag = "ticketing", params(("id" = Uuid, Path, description = "The endpoint")),
    responses((status = 200, description = "The endpoint", body = WebhookEndpoint), ReadProblems))]
pub async fn get_endpoint(
    State(app): State<App>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<WebhookEndpoint>, Problem> {
    Ok(axum::Json(find(&app, id).await?.into()))
}

/// Switch an endpoint on or off
#[utoipa::path(patch, path = "/webhook-endpoints/{id}", tag = "ticketing", params(("id" = Uuid, Path, description = "The endpoint")),
    request_body = WebhookEndpointChange,
    responses((status = 200, description = "The endpoint as it is now", body = WebhookEndpoint), WriteProblems))]
pub async fn patch_endpoint(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<WebhookEndpointChange>,
) -> Result<axum::Json<WebhookEndpoint>, Problem> {
    let row = app.store.enable_endpoint(Id(id), body.enabled, app.now_ms()).await?;
    app.outbox_wake.notify_one();
    Ok(axum::Json(row.ok_or_else(|| Problem::no("webhook endpoint", id))?.into()))
}

/// Remove an endpoint with its deliveries
#[utoipa::path(delete, path = "/webhook-endpoints/{id}", tag = "ticketing", params(("id" = Uuid, Path, description = "The endpoint")),
    responses((status = 204, description = "It is gone"), WriteProblems))]
pub async fn delete_endpoint(State(app): State<App>, Path(id): Path<Uuid>) -> Result<StatusCode, Problem> {
    if app.store.delete_endpoint(Id(id)).await? {
        Ok(StatusCode::NO_CONTENT)
    } else {
        Err(Problem::no("webhook endpoint", id))
    }
}
