//! Whether the service lives, whether it can work, and what it counts.

use super::Problem;
use super::problem::ReadProblems;
use crate::app::App;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use serde::Serialize;
use std::sync::OnceLock;
use utoipa::ToSchema;

/// Upper bounds of the buckets of durations, in s.
const SECONDS: [f64; 10] = [0.002, 0.005, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 60.0];

/// The service is there.
#[derive(Debug, Serialize, ToSchema)]
pub struct Health {
    /// Always `ok`.
    status: &'static str,
    /// Program version.
    version: &'static str,
}

const OK: Health = Health { status: "ok", version: env!("CARGO_PKG_VERSION") };

/// Is the process alive?
#[utoipa::path(get, path = "/healthz", tag = "service", security(()),
    responses((status = 200, description = "It is", body = Health), ReadProblems))]
pub async fn healthz() -> axum::Json<Health> {
    axum::Json(OK)
}

/// Can the service work? Looks at the database.
#[utoipa::path(get, path = "/readyz", tag = "service", security(()),
    responses((status = 200, description = "It can", body = Health), ReadProblems))]
pub async fn readyz(State(app): State<App>) -> Result<axum::Json<Health>, Problem> {
    if app.shutdown.is_cancelled() {
        return Err(Problem::not_ready("the service is going down"));
    }
    if !app.store.ready().await {
        return Err(Problem::not_ready("the database does not answer"));
    }
    Ok(axum::Json(OK))
}

/// The recorder of metrics; there is one a process.
pub fn recorder() -> Option<&'static PrometheusHandle> {
    static RECORDER: OnceLock<Option<PrometheusHandle>> = OnceLock::new();
    RECORDER
        .get_or_init(|| {
            PrometheusBuilder::new()
                .set_buckets_for_metric(Matcher::Suffix("_seconds".into()), &SECONDS)
                .ok()?
                .install_recorder()
                .ok()
        })
        .as_ref()
}

/// What the service counts, as text for Prometheus
#[utoipa::path(get, path = "/metrics", tag = "service",
    responses((status = 200, description = "Metrics", body = String, content_type = "text/plain"), ReadProblems))]
pub async fn get_metrics(State(app): State<App>) -> Result<impl IntoResponse, Problem> {
    let recorder = recorder().ok_or_else(|| Problem::not_ready("metrics are not recorded in this process"))?;
    let (queued, running) = app.store.job_counts().await?;
    metrics::gauge!("ropescope_jobs_queued").set(queued as f64);
    metrics::gauge!("ropescope_jobs_running").set(running as f64);
    metrics::gauge!("ropescope_ropes_with_unfit_model").set(app.store.ropes_with_unfit_model().await? as f64);
    recorder.run_upkeep();
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], recorder.render()))
}
