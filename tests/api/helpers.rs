//! A service of its own for every test, an engine that does as it is told, and frames to send.

use ropescope::clock::SystemClock;
use ropescope::config::Settings;
use ropescope::http::auth;
use ropescope::pipeline::budget::{self, BudgetFit};
use ropescope::pipeline::fit::ModelFit;
use ropescope::pipeline::found::{Found, FoundDefects};
use ropescope::pipeline::lay_length_table::LayLengthTable;
use ropescope::pipeline::learning_curve::LearningPoint;
use ropescope::pipeline::results::{
    AlarmRow, DefectRow, Kind, LayLengthRow, Level, NotCovered, Suggestion, Summary, Threshold, WireEstimate,
};
use ropescope::pipeline::training_range::LearntFrom;
use ropescope::pipeline::{
    Acquisition, Budget, FrameSource, InspectOptions, PipelineError, Progress, ProgressReport, TrainReport,
    TrainingRange,
};
use ropescope::service::Service;
use ropescope::store::tokens::Role;
use ropescope::workers::Engine;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tempfile::TempDir;
use uuid::Uuid;

/// Columns of the frames of tests.
pub const SENSOR_PX: u32 = 64;
/// Lines of the frames of tests.
pub const LINES: u32 = 100;

/// Threshold of the models of tests.
pub const TRAINED_THRESHOLD: f64 = 6.0;

/// Score from which on places are worth looking at again there.
pub const TRAINED_LOOK_AGAIN: f64 = 4.8;

fn toy_budget(budget: Budget) -> BudgetFit {
    let level = |line_score: f64, per_100m: f64| budget::Level {
        line_score,
        false_defects_per_100m: per_100m,
        at_least_per_100m: per_100m / 3.0,
        at_most_per_100m: per_100m * 3.0,
        reinspect_m_per_100m: per_100m * 0.11,
    };
    let per_100m = budget.false_defects().unwrap();
    BudgetFit {
        budget,
        alarm: level(TRAINED_THRESHOLD, per_100m),
        look_again: level(TRAINED_LOOK_AGAIN, 5.0 * per_100m),
        held_back_m: 1.6,
        peaks: 40,
        left_out: 0,
        tail_from: 4.0,
    }
}

/// The toy's models never fit.
fn toy_fit() -> ModelFit {
    ModelFit {
        fits: false,
        budget_per_100m: 2.0,
        false_defects_per_100m: Some(31.4),
        at_least_per_100m: Some(20.0),
        at_most_per_100m: Some(48.0),
        metres: 0.02,
        alarmed_share: 0.0,
        views: vec![],
    }
}

/// Stands in for vision: writes a small results folder, or waits to be stopped.
#[derive(Default)]
pub struct ToyEngine {
    /// While true, jobs run until they are told to stop.
    pub hold: AtomicBool,
}

impl ToyEngine {
    fn work(&self, progress: &dyn Progress) -> Result<(), PipelineError> {
        progress.report(ProgressReport { stage: "align", done_m: 0.01, total_m: 0.02 });
        while self.hold.load(Ordering::SeqCst) {
            if progress.cancelled() {
                return Err(PipelineError::Cancelled);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        progress.report(ProgressReport { stage: "write", done_m: 0.02, total_m: 0.02 });
        Ok(())
    }
}

impl Engine for ToyEngine {
    fn train(
        &self,
        ranges: &[TrainingRange<'_>],
        budget: Budget,
        model_path: &Path,
        progress: &dyn Progress,
    ) -> Result<TrainReport, PipelineError> {
        for range in ranges {
            range.source.load(0, 0)?;
        }
        self.work(progress)?;
        let learnt_from = |range: &TrainingRange<'_>| LearntFrom {
            acquisition: range.name.to_owned(),
            from_m: range.from_m.unwrap_or(0.0),
            to_m: range.to_m.unwrap_or(1.0),
            learnt_view_m: 1.0,
        };
        let first = learnt_from(&ranges[0]);
        std::fs::write(model_path, b"a model").unwrap();
        Ok(TrainReport {
            construction: ranges[0].acquisition.construction(),
            from_m: first.from_m,
            to_m: first.to_m,
            learnt_from: if ranges.len() > 1 { ranges.iter().map(learnt_from).collect() } else { vec![] },
            learnt_view_m: 1.0,
            threshold: TRAINED_THRESHOLD,
            threshold_origin: "a toy".into(),
            budget: Some(toy_budget(budget)),
            intact: vec![],
            learning_curve: [0.5, 1.0]
                .map(|metres| LearningPoint { metres, nats_per_pixel: 1.0 - 0.1 / metres })
                .to_vec(),
            seconds: 0.1,
            notes: vec![],
        })
    }

    fn inspect(
        &self,
        acquisition: &Acquisition,
        source: &dyn FrameSource,
        options: &InspectOptions,
        results: &Path,
        progress: &dyn Progress,
    ) -> Result<Summary, PipelineError> {
        self.work(progress)?;
        let mut frames = 0;
        while source.wait_for(0, frames)? {
            progress.found(found(acquisition, frames, options.model_path.is_some()));
            frames += 1;
        }
        std::fs::create_dir_all(results).unwrap();
        let mut table =
            LayLengthTable::create(results.join("lay_lengths.csv"), acquisition.rope.strands()).expect("a new file");
        for view in [None, Some(0)] {
            for frame in 0..source.frames(0) {
                table.write(&lay_length(acquisition, view, frame)).unwrap();
            }
        }
        table.finish().unwrap();
        let mut found = None;
        if options.model_path.is_some() {
            let defects = [defect(acquisition)];
            std::fs::write(results.join("defects.json"), serde_json::to_vec(&defects).unwrap()).unwrap();
            found = Some(defects.len());
            let again = [look_again(acquisition, source.frames(0) * LINES as usize - 1)];
            std::fs::write(results.join("look_again.json"), serde_json::to_vec(&again).unwrap()).unwrap();
            for view in 0..source.views() {
                let folder = results.join(format!("maps/view{view}"));
                std::fs::create_dir_all(&folder).unwrap();
                let mut scores = Vec::new();
                for frame in 0..source.frames(view) {
                    let pixels = source.load(view, frame)?;
                    let mut map = image::GrayImage::from_pixel(SENSOR_PX, pixels.lines as u32, image::Luma([200]));
                    if frame == 0 {
                        map.put_pixel(15, 42, image::Luma([3]));
                    }
                    map.save(folder.join(format!("frame_{frame:06}.png"))).unwrap();
                    for line in 0..pixels.lines {
                        let score = if frame == 0 && line == 42 {
                            9.0
                        } else if frame == 2 && line == LINES as usize - 1 {
                            5.0 // under the threshold
                        } else if frame == 1 {
                            f32::NAN
                        } else {
                            1.0
                        };
                        scores.extend(f32::to_le_bytes(score));
                    }
                }
                std::fs::write(results.join(format!("line_scores_view{view}.f32")), scores).unwrap();
            }
        }
        Ok(Summary {
            ropescope_version: "test".into(),
            model: options.model_path.as_ref().map(|_| "toy".into()),
            construction: acquisition.construction(),
            lines: source.frames(0) * LINES as usize,
            metres: 0.03,
            covered_view_m: 0.01,
            not_covered: vec![NotCovered {
                view: 0,
                from_m: acquisition.position_m(LINES as usize),
                to_m: acquisition.position_m(2 * LINES as usize),
                reason: "too dark".into(),
            }],
            threshold: options.model_path.as_ref().map(|_| {
                options.threshold.clone().unwrap_or_else(|| Threshold {
                    line_score: TRAINED_THRESHOLD,
                    look_again_line_score: Some(TRAINED_LOOK_AGAIN),
                    origin: "a toy".into(),
                })
            }),
            defects: found,
            look_again: found,
            diameter: None,
            fit: options.model_path.as_ref().map(|_| toy_fit()),
            seconds: 0.1,
            metres_per_second: 1.0,
            notes: vec![],
        })
    }
}

/// What the toy engine measures in a frame; one stretch could not be measured.
fn lay_length(acquisition: &Acquisition, view: Option<usize>, frame: usize) -> LayLengthRow {
    let first_line = frame * LINES as usize;
    let half_m = 0.5 * f64::from(LINES) * acquisition.line_pitch_mm / 1000.0;
    let strands = acquisition.rope.strands();
    let row = LayLengthRow {
        view,
        first_line,
        last_line: first_line + LINES as usize - 1,
        position_m: acquisition.position_m(first_line) + half_m,
        wires: vec![WireEstimate::default(); strands],
        reason: Some("too dark".into()),
        ..LayLengthRow::default()
    };
    if frame == 1 {
        return row;
    }
    let wire = WireEstimate {
        lay_mm: Some(-70.5),
        lay_sd_mm: Some(0.2),
        phase_rad: Some(0.1),
        phase_sd_rad: Some(0.004),
        score: Some(0.8),
    };
    LayLengthRow {
        strand_lay_mm: Some(137.0 + frame as f64),
        strand_lay_sd_mm: Some(0.1),
        strand_phase_rad: Some(0.5),
        strand_phase_sd_rad: Some(0.002),
        strand_score: Some(0.9),
        strand_spread_rad: Some(0.01),
        strand_spread_sd_rad: Some(0.001),
        diameter_mm: Some(20.0),
        diameter_sd_mm: Some(0.2),
        ovality_percent: Some(0.8),
        ovality_sd_percent: Some(0.3),
        wires: vec![wire; strands],
        reason: None,
        ..row
    }
}

/// The defect that the toy engine finds in every rope.
fn defect(acquisition: &Acquisition) -> DefectRow {
    let alarm = AlarmRow { view: 0, first_line: 40, last_line: 44, first_column: 10, last_column: 20, peak_score: 9.0 };
    DefectRow {
        id: 0,
        level: Level::Alarm,
        from_m: acquisition.position_m(40),
        to_m: acquisition.position_m(45),
        strand: Some(2),
        wire: None,
        angle_deg: Some(300.0),
        peak_score: 9.0,
        rank: Some(1),
        suggestion: Some(Suggestion {
            kind: Kind::Gap,
            why: "dark over 4 mm".into(),
            length_mm: 4.0,
            width_wires: 1.0,
            area_mm2: 5.5,
            gray_steps: -6.0,
            texture: 1.2,
            beyond_outline_mm: 0.0,
        }),
        alarms: vec![alarm],
    }
}

/// The place that it would look at again: the last line.
fn look_again(acquisition: &Acquisition, line: usize) -> DefectRow {
    let alarm =
        AlarmRow { view: 0, first_line: line, last_line: line, first_column: 4, last_column: 5, peak_score: 5.0 };
    DefectRow {
        id: 1,
        level: Level::LookAgain,
        from_m: acquisition.position_m(line),
        to_m: acquisition.position_m(line + 1),
        peak_score: 5.0,
        alarms: vec![alarm],
        ..DefectRow::default()
    }
}

/// What the toy engine finds in a frame.
fn found(acquisition: &Acquisition, frame: usize, with_model: bool) -> Found {
    let first_line = frame * LINES as usize;
    let row = LayLengthRow {
        view: None,
        first_line,
        last_line: first_line + LINES as usize - 1,
        position_m: acquisition.position_m(first_line + LINES as usize / 2),
        strand_lay_mm: Some(137.0 + frame as f64),
        ..LayLengthRow::default()
    };
    let rows = if with_model { vec![defect(acquisition)] } else { vec![] };
    Found { lay_lengths: vec![row], defects: Some(FoundDefects { from: 0, rows }) }
}

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
