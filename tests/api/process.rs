//! The real program as a process of its own, and simulated rope for it.

use crate::helpers::{Caller, rope};
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

const PROGRAM: &str = env!("CARGO_BIN_EXE_ropescope");

/// `ropescope serve` or `worker` as a process of its own, killed when dropped.
pub struct Process {
    pub child: Child,
    base: String,
}

impl Process {
    /// Starts it, and waits until it listens.
    pub fn start(data: &Path) -> Self {
        Self::begin(&["serve", "--listen", "127.0.0.1:0"], data)
    }

    fn begin(command: &[&str], data: &Path) -> Self {
        let mut child = Command::new(PROGRAM)
            .args(command)
            .arg("--data")
            .arg(data)
            .env("RUST_LOG", "warn")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said = line.trim().strip_prefix("listening on ").or(line.trim().strip_prefix("working on "));
        let base = said.unwrap_or_else(|| panic!("{line:?}")).to_owned();
        Self { child, base }
    }

    /// Starts `ropescope worker` beside a service on the same folder, and waits until it works.
    pub fn start_worker(data: &Path) -> Self {
        Self::begin(&["worker"], data)
    }

    /// Starts a service that runs no jobs.
    pub fn start_without_workers(data: &Path) -> Self {
        Self::begin(&["serve", "--no-workers", "--listen", "127.0.0.1:0"], data)
    }

    /// SIGKILL: no handler runs, nothing is flushed.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An administrator's token.
pub fn token(data: &Path) -> String {
    let output =
        Command::new(PROGRAM).args(["token", "create", "--role", "admin", "--data"]).arg(data).output().unwrap();
    String::from_utf8(output.stdout).unwrap().lines().last().unwrap().to_owned()
}

/// Somebody with a token.
pub fn caller(process: &Process, token: &str) -> Caller {
    ropescope::tls::install();
    Caller { client: reqwest::Client::new(), base: process.base.clone(), token: Some(token.to_owned()) }
}

/// A folder with a simulated acquisition.
pub fn simulated(recipe: &Recipe) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_acquisition(&Scene::new(recipe, 3).unwrap(), folder.path(), |_| {}).unwrap();
    folder
}

/// Uploads a simulated acquisition and returns its id.
pub async fn upload(admin: &Caller, folder: &Path) -> String {
    let rope = rope_of(admin, folder).await;
    let id = open(admin, folder, &rope).await;
    for (view, number, bytes) in frames(folder) {
        admin.put_frame(&id, view, number, bytes).await.ok(201);
    }
    complete(admin, folder, &id).await;
    id
}

/// Creates the rope of a simulated acquisition.
pub async fn rope_of(admin: &Caller, folder: &Path) -> Value {
    let file: Value = serde_json::from_slice(&std::fs::read(folder.join("rope.json")).unwrap()).unwrap();
    let mut body = rope(&admin.ropeway().await);
    for key in ["strands", "wires_per_strand", "rope_diameter_mm", "strand_lay_mm", "wire_lay_mm"] {
        body["design"][key] = file[key].clone();
    }
    admin.post("ropes", body).await.ok(201)["id"].clone()
}

/// Creates a simulated acquisition without any of its frames.
pub async fn open(admin: &Caller, folder: &Path, rope: &Value) -> String {
    let file: Value = serde_json::from_slice(&std::fs::read(folder.join("rope.json")).unwrap()).unwrap();
    let views: Vec<Value> =
        file["views"].as_array().unwrap().iter().map(|v| json!({ "angle_deg": v["angle_deg"] })).collect();
    let body = json!({ "rope_id": rope, "line_pitch_mm": file["line_pitch_mm"], "sensor_px": file["sensor_px"], "views": views });
    admin.post("acquisitions", body).await.ok(201)["id"].as_str().unwrap().to_owned()
}

/// Says that all frames of a simulated acquisition were sent.
pub async fn complete(admin: &Caller, folder: &Path, id: &str) {
    let mut views: Vec<Value> = Vec::new();
    for (view, number, _) in frames(folder) {
        views.resize(views.len().max(view as usize + 1), Value::Null);
        views[view as usize] = json!({ "frames": number + 1 });
    }
    admin.post(&format!("acquisitions/{id}/completion"), json!({ "views": views })).await.ok(200);
}

/// View, number and bytes of every frame of a simulated acquisition, along each view.
pub fn frames(folder: &Path) -> Vec<(u32, u32, Vec<u8>)> {
    let mut frames = Vec::new();
    for view in 0.. {
        let path = |n: u32| folder.join(format!("view{view}")).join(format!("frame_{n:06}.png"));
        let of_view: Vec<_> = (0..).map_while(|n| Some((view, n, std::fs::read(path(n)).ok()?))).collect();
        if of_view.is_empty() {
            return frames;
        }
        frames.extend(of_view);
    }
    frames
}
