//! Every route, and who may use it.

use super::auth::{ADMIN, EVERYBODY, OPERATORS, READERS, Roles, TICKETERS, UPLOADERS, authorise};
use super::{
    Problem, acquisitions, completion, defect_card, defects, deliveries, frames, guard, health, history,
    inspection_thresholds, inspections, job_events, jobs, lay_lengths, line_scores, manifest, models, openapi,
    pictures, previews, provisional, receipts, rope_windows, ropes, ropeways, surface_alarms, threshold_preview,
    thresholds, tickets, tokens, tus, unpack, verdicts, wanted, webhooks,
};
use crate::app::App;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, Uri};
use axum::middleware::from_fn_with_state;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// A group of routes behind the same roles, with small bodies and short answers.
fn group(app: &App, roles: Roles, routes: OpenApiRouter<App>) -> OpenApiRouter<App> {
    slow_group(app, roles, routes.route_layer(from_fn_with_state(app.clone(), guard::in_time)))
}

/// A group of routes behind the same roles that look after their own time.
fn slow_group(app: &App, roles: Roles, routes: OpenApiRouter<App>) -> OpenApiRouter<App> {
    routes.route_layer(from_fn_with_state((app.clone(), roles), authorise))
}

fn api(app: &App) -> OpenApiRouter<App> {
    let everybody = OpenApiRouter::new()
        .routes(routes!(ropeways::list_ropeways))
        .routes(routes!(ropeways::get_ropeway))
        .routes(routes!(ropes::list_ropes))
        .routes(routes!(ropes::get_rope))
        .routes(routes!(rope_windows::get_rope_windows))
        .routes(routes!(acquisitions::list_acquisitions))
        .routes(routes!(acquisitions::get_acquisition))
        .routes(routes!(completion::get_missing))
        .routes(routes!(previews::get_previews))
        .routes(routes!(wanted::get_wanted));
    let uploaders = OpenApiRouter::new()
        .routes(routes!(acquisitions::create_acquisition))
        .routes(routes!(acquisitions::put_acquisition))
        .routes(routes!(acquisitions::delete_acquisition))
        .routes(routes!(completion::complete_acquisition))
        .routes(routes!(manifest::post_manifest))
        .routes(routes!(receipts::post_receipt))
        .routes(routes!(unpack::get_archive));
    let uploads = OpenApiRouter::new().routes(routes!(frames::put_frame)).routes(routes!(previews::put_preview));
    let readers = OpenApiRouter::new()
        .routes(routes!(frames::get_frame))
        .routes(routes!(jobs::list_jobs))
        .routes(routes!(jobs::get_job))
        .routes(routes!(job_events::get_job_events))
        .routes(routes!(provisional::get_provisional_lay_lengths))
        .routes(routes!(provisional::get_provisional_defects))
        .routes(routes!(models::list_models))
        .routes(routes!(models::get_model))
        .routes(routes!(models::get_model_file))
        .routes(routes!(thresholds::list_thresholds))
        .routes(routes!(inspections::list_inspections))
        .routes(routes!(inspections::get_inspection))
        .routes(routes!(inspection_thresholds::list_inspection_thresholds))
        .routes(routes!(receipts::get_certificate))
        .routes(routes!(receipts::get_signing_key))
        .routes(routes!(lay_lengths::get_lay_lengths))
        .routes(routes!(line_scores::get_line_scores))
        .routes(routes!(surface_alarms::get_surface_alarms))
        .routes(routes!(pictures::get_likelihood))
        .routes(routes!(pictures::get_image))
        .routes(routes!(defects::get_inspection_defects))
        .routes(routes!(defects::list_defects))
        .routes(routes!(defects::get_defect))
        .routes(routes!(defect_card::get_defect_card))
        .routes(routes!(history::get_rope_history))
        .routes(routes!(history::get_ropeway_history));
    let ticketers = OpenApiRouter::new().routes(routes!(tickets::put_ticket));
    let operators = OpenApiRouter::new()
        .routes(routes!(ropeways::create_ropeway))
        .routes(routes!(ropeways::put_ropeway))
        .routes(routes!(ropeways::put_storage))
        .routes(routes!(ropes::create_rope))
        .routes(routes!(ropes::put_rope))
        .routes(routes!(ropes::patch_ticketing))
        .routes(routes!(rope_windows::put_rope_windows))
        .routes(routes!(jobs::create_job))
        .routes(routes!(jobs::cancel_job))
        .routes(routes!(thresholds::put_threshold))
        .routes(routes!(inspection_thresholds::apply_threshold))
        .routes(routes!(threshold_preview::preview_threshold))
        .routes(routes!(verdicts::post_verdict))
        .routes(routes!(deliveries::list_deliveries))
        .routes(routes!(deliveries::get_delivery))
        .routes(routes!(deliveries::redeliver));
    let admin = OpenApiRouter::new()
        .routes(routes!(tokens::create_token))
        .routes(routes!(tokens::list_tokens))
        .routes(routes!(tokens::revoke_token))
        .routes(routes!(webhooks::create_endpoint))
        .routes(routes!(webhooks::list_endpoints))
        .routes(routes!(webhooks::get_endpoint))
        .routes(routes!(webhooks::patch_endpoint))
        .routes(routes!(webhooks::delete_endpoint));
    OpenApiRouter::new()
        .merge(group(app, EVERYBODY, everybody))
        .merge(group(app, UPLOADERS, uploaders))
        .merge(slow_group(app, UPLOADERS, uploads))
        .merge(group(app, READERS, readers))
        .merge(group(app, TICKETERS, ticketers))
        .merge(group(app, OPERATORS, operators))
        .merge(group(app, ADMIN, admin))
}

fn all(app: &App) -> (Router<App>, utoipa::openapi::OpenApi) {
    let metrics = OpenApiRouter::new().routes(routes!(health::get_metrics));
    let (router, mut contract) = OpenApiRouter::with_openapi(openapi::frame())
        .nest("/api/v1", api(app))
        .merge(group(app, READERS, metrics))
        .routes(routes!(health::healthz))
        .routes(routes!(health::readyz))
        .split_for_parts();
    openapi::absent_not_null(&mut contract);
    (router, contract)
}

/// The contract that the routes amount to.
pub fn contract(app: &App) -> utoipa::openapi::OpenApi {
    all(app).1
}

/// The whole service as a router.
pub fn router(app: &App) -> Router {
    health::recorder(); // counts from the first request on
    let (routes, contract) = all(app);
    let routes = routes
        .merge(openapi::pages(contract))
        .merge(Router::new().nest("/api/v1", tus::routes(app)))
        .layer(DefaultBodyLimit::max(app.settings.limits.json_bytes))
        .method_not_allowed_fallback(no_method)
        .fallback(no_route)
        .with_state(app.clone());
    guard::guarded(routes, app)
}

async fn no_route(uri: Uri) -> Problem {
    Problem::not_found(format!("nothing is at {}", uri.path()))
}

async fn no_method(method: Method, uri: Uri) -> Problem {
    Problem::method_not_allowed(format!("{} does not have {method}", uri.path()))
}
