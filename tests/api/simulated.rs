//! Simulated rope for tests with the real program.

use crate::app::{Caller, rope};
use crate::process::Process;
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use serde_json::{Value, json};
use std::path::Path;

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
