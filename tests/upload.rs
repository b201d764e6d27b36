//! The laptop's client against the real service, over links that fail.

#![expect(clippy::unwrap_used, reason = "a failed expectation of a test may panic")]

use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use ropescope::config::Settings;
use ropescope::http::auth;
use ropescope::service::Service;
use ropescope::simulate::write::encode_png;
use ropescope::store::tokens::Role;
use ropescope::upload::{Client, ClientError, Names, Options, Plan, Tick, UploadError, upload};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const FRAMES: usize = 5;
const SENSOR_PX: u32 = 96;

/// A folder of two views with `FRAMES` small frames each.
fn folder(at: &Path, diameter_mm: f64) {
    let rope = serde_json::json!({
        "strands": 6, "wires_per_strand": 9, "rope_diameter_mm": diameter_mm, "strand_lay_mm": 220.0, "wire_lay_mm": -95.0,
        "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "ropeway": "North", "rope": "track rope 1",
        "views": [{"folder": "view0", "angle_deg": 0.0}, {"folder": "view1", "angle_deg": 90.0}],
    });
    std::fs::write(at.join("rope.json"), rope.to_string()).unwrap();
    for view in 0..2 {
        let view_folder = at.join(format!("view{view}"));
        std::fs::create_dir_all(&view_folder).unwrap();
        for frame in 0..FRAMES {
            let pixels: Vec<u8> = (0..SENSOR_PX * 20).map(|p| (p as usize * (frame + 7 * view + 3)) as u8).collect();
            let png = encode_png(SENSOR_PX, 20, &pixels).unwrap();
            std::fs::write(view_folder.join(format!("frame_{frame:06}.png")), png).unwrap();
        }
    }
}

async fn service(data: &Path) -> Service {
    ropescope::tls::install();
    let settings = Settings { listen: ([127, 0, 0, 1], 0).into(), workers: 0, ..Settings::new(data) };
    Service::start(settings).await.unwrap()
}

async fn token(service: &Service, role: Role) -> String {
    auth::issue(&service.app.store, "test", role, service.app.now_ms()).await.unwrap().1
}

fn client(url: &str, token: &str) -> Client {
    Client::new(url, token, Duration::from_secs(60), 1).unwrap()
}

struct Flaky {
    target: String,
    http: reqwest::Client,
    requests: AtomicUsize,
}

/// Stands before a service and spoils two requests of five: one is not forwarded, the answer of another is lost.
async fn flaky_front(target: String) -> String {
    let state = Arc::new(Flaky { target, http: reqwest::Client::new(), requests: AtomicUsize::new(0) });
    let router = axum::Router::new().fallback(forward).with_state(state);
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    tokio::spawn(async move { axum::serve(listener, router).await.unwrap() });
    url
}

async fn forward(State(front): State<Arc<Flaky>>, request: Request) -> Response {
    let n = front.requests.fetch_add(1, Ordering::SeqCst);
    if n % 5 == 1 {
        return StatusCode::BAD_GATEWAY.into_response();
    }
    let (parts, body) = request.into_parts();
    let body = axum::body::to_bytes(body, usize::MAX).await.unwrap();
    let path = parts.uri.path_and_query().unwrap().as_str();
    let answer = front
        .http
        .request(parts.method, format!("{}{path}", front.target))
        .headers(parts.headers)
        .body(body)
        .send()
        .await
        .unwrap();
    if n % 5 == 3 {
        return StatusCode::GATEWAY_TIMEOUT.into_response();
    }
    let status = answer.status();
    (status, answer.bytes().await.unwrap()).into_response()
}

#[tokio::test]
async fn a_whole_folder_arrives_over_a_link_that_spoils_two_requests_of_five() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    folder(source.path(), 32.0);
    let service = service(data.path()).await;
    let front = flaky_front(service.base_url()).await;
    let client = client(&front, &token(&service, Role::Admin).await);
    let plan = Plan::read(source.path(), &Names::default()).unwrap();
    let ticks = Mutex::new(Vec::<Tick>::new());
    let report =
        upload(&client, &plan, &Options::default(), |t: &Tick| ticks.lock().unwrap().push(t.clone())).await.unwrap();
    assert_eq!((report.frames, report.sent_frames), (2 * FRAMES, 2 * FRAMES));
    let ticks = ticks.into_inner().unwrap();
    assert_eq!((ticks[0].held, ticks.last().unwrap().held), (0, 2 * FRAMES));
    assert_eq!(ticks.last().unwrap().sent_bytes, plan.bytes());
    let stored = client.get(&format!("/acquisitions/{}", report.acquisition_id)).await.unwrap();
    assert_eq!(stored["state"], "complete");
    for (view, frames) in plan.frames.iter().enumerate() {
        for (number, frame) in frames.iter().enumerate() {
            let path = format!("/acquisitions/{}/views/{view}/frames/{number}", report.acquisition_id);
            assert_eq!(client.get_bytes(&path).await.unwrap(), std::fs::read(&frame.path).unwrap());
        }
    }
    service.stop().await;
}

#[tokio::test]
async fn a_second_run_sends_what_the_first_did_not() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    folder(source.path(), 32.0);
    let service = service(data.path()).await;
    let client = client(&service.base_url(), &token(&service, Role::Admin).await);
    let plan = Plan::read(source.path(), &Names::default()).unwrap();
    // The first run dies after its third frame.
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let stop = Mutex::new(Some(stop));
    let one_by_one = Options { connections: 1, ..Options::default() };
    let first = upload(&client, &plan, &one_by_one, |tick: &Tick| {
        if tick.held == 3 {
            let _ = stop.lock().unwrap().take().map(|s| s.send(()));
        }
    });
    tokio::select! {
        _ = first => panic!("it should have been interrupted"),
        _ = stopped => {}
    }
    let report = upload(&client, &plan, &one_by_one, |_| {}).await.unwrap();
    assert!((2 * FRAMES - 4..=2 * FRAMES - 3).contains(&report.sent_frames), "{report:?}");
    let again = upload(&client, &plan, &one_by_one, |_| {}).await.unwrap();
    assert_eq!((again.acquisition_id, again.sent_frames), (report.acquisition_id, 0));
    service.stop().await;
}

#[tokio::test]
async fn the_upload_role_suffices_once_the_rope_exists() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    folder(source.path(), 32.0);
    let service = service(data.path()).await;
    let laptop = client(&service.base_url(), &token(&service, Role::Upload).await);
    let plan = Plan::read(source.path(), &Names::default()).unwrap();
    let error = upload(&laptop, &plan, &Options::default(), |_| {}).await.unwrap_err();
    assert!(matches!(&error, UploadError::Client(e) if e.status() == Some(403)), "{error}");
    let office = client(&service.base_url(), &token(&service, Role::Operator).await);
    let ropeway = office.post("/ropeways", &serde_json::json!({"name": "North"})).await.unwrap();
    let rope = serde_json::json!({"ropeway_id": ropeway["id"], "name": "track rope 1", "design": plan.design});
    let rope = office.post("/ropes", &rope).await.unwrap();
    let report = upload(&laptop, &plan, &Options::default(), |_| {}).await.unwrap();
    assert_eq!(report.rope_id.to_string(), rope["id"].as_str().unwrap());
    service.stop().await;
}

#[tokio::test]
async fn another_rope_under_the_same_name_is_refused_with_both_values() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    folder(source.path(), 32.0);
    let service = service(data.path()).await;
    let client = client(&service.base_url(), &token(&service, Role::Admin).await);
    upload(&client, &Plan::read(source.path(), &Names::default()).unwrap(), &Options::default(), |_| {}).await.unwrap();
    folder(source.path(), 33.0);
    let plan = Plan::read(source.path(), &Names::default()).unwrap();
    let error = upload(&client, &plan, &Options::default(), |_| {}).await.unwrap_err().to_string();
    assert!(error.contains("rope_diameter_mm 32.0 at the service, but rope.json says 33.0"), "{error}");
    let other = Names { rope: Some("track rope 2".into()), ..Names::default() };
    upload(&client, &Plan::read(source.path(), &other).unwrap(), &Options::default(), |_| {}).await.unwrap();
    service.stop().await;
}

#[tokio::test]
async fn when_nobody_answers_patience_ends_with_a_sentence() {
    let source = tempfile::tempdir().unwrap();
    folder(source.path(), 32.0);
    let plan = Plan::read(source.path(), &Names::default()).unwrap();
    let nobody = Client::new("http://127.0.0.1:9", "rope_x_y", Duration::from_secs(1), 1).unwrap();
    let error = upload(&nobody, &plan, &Options::default(), |_| {}).await.unwrap_err();
    assert!(matches!(&error, UploadError::Client(ClientError::Unreachable { tries, .. }) if *tries > 1), "{error}");
    assert!(Client::new("ftp://host", "t", Duration::ZERO, 1).is_err());
}
