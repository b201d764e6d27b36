//! A service of its own for every test, callers with their answers, and frames to send.

use ropescope::clock::SystemClock;
use ropescope::config::Settings;
use ropescope::http::auth;
use ropescope::service::Service;
use ropescope::store::tokens::Role;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;
use uuid::Uuid;

use crate::toy_engine::ToyEngine;

/// Columns of the frames of tests.
pub const SENSOR_PX: u32 = 64;
/// Lines of the frames of tests.
pub const LINES: u32 = 100;

/// A running service with an administrator.
pub struct TestApp {
    pub service: Service,
    pub engine: Arc<ToyEngine>,
    pub admin: Caller,
    pub data: TempDir,
}

/// Somebody with (or without) a token.
#[derive(Clone)]
pub struct Caller {
    pub client: reqwest::Client,
    pub base: String,
    pub token: Option<String>,
}

/// An answer that was read.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub headers: reqwest::header::HeaderMap,
    pub bytes: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.bytes)
            .unwrap_or_else(|e| panic!("{e} in {:?}", String::from_utf8_lossy(&self.bytes)))
    }

    pub fn text(&self) -> String {
        String::from_utf8(self.bytes.clone()).unwrap()
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |v| v.to_str().unwrap())
    }

    /// The body, after checking that all went well.
    pub fn ok(&self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", String::from_utf8_lossy(&self.bytes));
        if self.bytes.is_empty() { Value::Null } else { self.json() }
    }

    /// Checks that all went well where there is no body to read.
    pub fn ok_status(&self, status: u16) {
        assert_eq!(self.status, status, "{}", String::from_utf8_lossy(&self.bytes));
    }

    /// The problem, after checking that it is one and of this kind.
    pub fn problem(&self, status: u16, slug: &str) -> Value {
        assert_eq!(self.status, status, "{}", String::from_utf8_lossy(&self.bytes));
        assert_eq!(self.header("content-type"), "application/problem+json");
        let problem = self.json();
        assert_eq!(problem["type"], format!("/problems/{slug}"), "{problem}");
        assert_eq!(problem["status"], status);
        problem
    }
}

impl Caller {
    pub fn request(&self, method: &str, path: &str) -> reqwest::RequestBuilder {
        let path = if path.starts_with('/') { path.to_owned() } else { format!("/api/v1/{path}") };
        let request = self.client.request(method.parse().unwrap(), format!("{}{path}", self.base));
        match &self.token {
            Some(token) => request.bearer_auth(token),
            None => request,
        }
    }

    pub async fn send(&self, request: reqwest::RequestBuilder) -> Answer {
        let response = request.send().await.unwrap();
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        Answer { status, headers, bytes: response.bytes().await.unwrap().to_vec() }
    }

    pub async fn get(&self, path: &str) -> Answer {
        self.send(self.request("GET", path)).await
    }

    pub async fn call(&self, method: &str, path: &str, body: Value) -> Answer {
        self.send(self.request(method, path).json(&body)).await
    }

    pub async fn post(&self, path: &str, body: Value) -> Answer {
        self.call("POST", path, body).await
    }

    pub async fn put_frame(&self, acquisition: &str, view: u32, frame: u32, bytes: Vec<u8>) -> Answer {
        let path = format!("acquisitions/{acquisition}/views/{view}/frames/{frame}");
        self.send(self.request("PUT", &path).header("content-type", "image/png").body(bytes)).await
    }

    pub async fn ropeway(&self) -> String {
        self.post("ropeways", json!({ "name": "North" })).await.ok(201)["id"].as_str().unwrap().to_owned()
    }

    pub async fn rope(&self) -> String {
        let ropeway = self.ropeway().await;
        self.post("ropes", rope(&ropeway)).await.ok(201)["id"].as_str().unwrap().to_owned()
    }

    /// An open acquisition with one view per entry, so many frames each.
    pub async fn acquisition(&self, rope: &str, frames: &[Option<u32>]) -> String {
        let views: Vec<_> = frames.iter().map(|f| json!({ "angle_deg": 0.0, "frames": f })).collect();
        let body =
            json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "views": views, "start_m": 5.0 });
        self.post("acquisitions", body).await.ok(201)["id"].as_str().unwrap().to_owned()
    }

    /// A complete acquisition of one view with three frames.
    pub async fn complete_acquisition(&self, rope: &str) -> String {
        let id = self.acquisition(rope, &[Some(3)]).await;
        for n in 0..3 {
            self.put_frame(&id, 0, n, png(n as u8)).await.ok(201);
        }
        self.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
        id
    }

    /// Queues a job and waits for its end.
    pub async fn run(&self, body: Value) -> Value {
        let job = self.post("jobs", body).await.ok(202);
        self.ended(job["id"].as_str().unwrap()).await
    }

    /// Waits for the end of a job; long, because real ones run in these tests too, and on busy machines.
    pub async fn ended(&self, job: &str) -> Value {
        for _ in 0..4000 {
            let job = self.get(&format!("jobs/{job}")).await.ok(200);
            if !["queued", "running"].contains(&job["state"].as_str().unwrap()) {
                return job;
            }
            tokio::time::sleep(Duration::from_millis(25)).await;
        }
        panic!("job {job} does not end");
    }

    /// Waits until a job is in a state.
    pub async fn reached(&self, job: &str, state: &str) {
        for _ in 0..400 {
            if self.get(&format!("jobs/{job}")).await.ok(200)["state"] == state {
                return;
            }
            tokio::time::sleep(Duration::from_millis(25)).await;
        }
        panic!("job {job} does not become {state}");
    }

    /// A rope with a trained model and one inspection with it: (rope, model, inspection).
    pub async fn inspected(&self) -> (String, String, String) {
        let rope = self.rope().await;
        let acquisition = self.complete_acquisition(&rope).await;
        let job = self.run(json!({ "kind": "train", "acquisition_id": acquisition })).await;
        let model = job["result"]["model_id"].as_str().unwrap_or_else(|| panic!("{job}")).to_owned();
        let job = self.run(json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model })).await;
        let inspection = job["result"]["inspection_id"].as_str().unwrap_or_else(|| panic!("{job}")).to_owned();
        (rope, model, inspection)
    }
}

impl TestApp {
    pub async fn start() -> Self {
        Self::start_with(|_| {}).await
    }

    pub async fn start_with(change: impl FnOnce(&mut Settings)) -> Self {
        let data = tempfile::tempdir().unwrap();
        Self::start_on(data, change).await
    }

    pub async fn start_on(data: TempDir, change: impl FnOnce(&mut Settings)) -> Self {
        ropescope::tls::install();
        let engine = Arc::new(ToyEngine::default());
        let mut settings = settings(data.path());
        change(&mut settings);
        let service = Service::start_with(settings, Arc::new(SystemClock), engine.clone()).await.unwrap();
        let (_, token) = auth::issue(&service.app.store, "test", Role::Admin, service.app.now_ms()).await.unwrap();
        let admin = Caller { client: reqwest::Client::new(), base: service.base_url(), token: Some(token) };
        Self { service, engine, admin, data }
    }

    pub async fn caller(&self, role: Role) -> Caller {
        let app = &self.service.app;
        let (_, token) = auth::issue(&app.store, role.name(), role, app.now_ms()).await.unwrap();
        Caller { token: Some(token), ..self.admin.clone() }
    }
}

/// Settings of tests: a free port, quick heartbeats.
pub fn settings(data: &Path) -> Settings {
    let mut settings = Settings::new(data);
    settings.listen = SocketAddr::from(([127, 0, 0, 1], 0));
    settings.lease.heartbeat = Duration::from_millis(50);
    settings.lease.poll = Duration::from_millis(100);
    settings
}

pub fn design() -> Value {
    json!({ "strands": 6, "wires_per_strand": 9, "rope_diameter_mm": 20.46, "strand_lay_mm": 137.5, "wire_lay_mm": -70.5 })
}

pub fn rope(ropeway: &str) -> Value {
    json!({ "ropeway_id": ropeway, "name": "track 1", "design": design() })
}

pub fn new_id() -> String {
    Uuid::new_v4().to_string()
}

/// A frame of tests; `seed` makes it another one.
pub fn png(seed: u8) -> Vec<u8> {
    png_of(SENSOR_PX, LINES, seed)
}

pub fn png_of(width: u32, height: u32, seed: u8) -> Vec<u8> {
    let image =
        image::GrayImage::from_fn(width, height, |x, y| image::Luma([(x as u8).wrapping_mul(7) ^ y as u8 ^ seed]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}
