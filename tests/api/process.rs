//! The real program as a process of its own, and simulated rope for it.

use crate::helpers::{Caller, rope};
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

const PROGRAM: &str = env!("CARGO_BIN_EXE_ropescope");

/// `ropescope serve` as a process of its own, killed when dropped.
pub struct Process {
    pub child: Child,
    base: String,
}

impl Process {
    /// Starts it, and waits until it listens.
    pub fn start(data: &Path) -> Self {
        let mut child = Command::new(PROGRAM)
            .args(["serve", "--listen", "127.0.0.1:0", "--data"])
            .arg(data)
            .env("RUST_LOG", "warn")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let base = line.trim().strip_prefix("listening on ").unwrap_or_else(|| panic!("{line:?}")).to_owned();
        Self { child, base }
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
    let file: Value = serde_json::from_slice(&std::fs::read(folder.join("rope.json")).unwrap()).unwrap();
    let mut body = rope(&admin.ropeway().await);
    for key in ["strands", "wires_per_strand", "rope_diameter_mm", "strand_lay_mm", "wire_lay_mm"] {
        body["design"][key] = file[key].clone();
    }
    let rope = admin.post("ropes", body).await.ok(201)["id"].clone();
    let views: Vec<Value> =
        file["views"].as_array().unwrap().iter().map(|v| json!({ "angle_deg": v["angle_deg"] })).collect();
    let body = json!({ "rope_id": rope, "line_pitch_mm": file["line_pitch_mm"], "sensor_px": file["sensor_px"], "views": views });
    let id = admin.post("acquisitions", body).await.ok(201)["id"].as_str().unwrap().to_owned();
    let mut counts = Vec::new();
    for (v, view) in file["views"].as_array().unwrap().iter().enumerate() {
        let mut n = 0;
        while let Ok(bytes) =
            std::fs::read(folder.join(view["folder"].as_str().unwrap()).join(format!("frame_{n:06}.png")))
        {
            admin.put_frame(&id, v as u32, n, bytes).await.ok(201);
            n += 1;
        }
        counts.push(json!({ "frames": n }));
    }
    admin.post(&format!("acquisitions/{id}/completion"), json!({ "views": counts })).await.ok(200);
    id
}
