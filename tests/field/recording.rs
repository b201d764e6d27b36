//! A recording to upload, and what a service made of it.

use ropescope::simulate::write::encode_png;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Columns of its frames.
pub const SENSOR_PX: u32 = 128;

/// A folder of two views with noise: frames of about `SENSOR_PX * lines` bytes each.
pub fn recording(at: &Path, frames_a_view: usize, lines: u32) {
    let rope = json!({
        "strands": 6, "wires_per_strand": 9, "rope_diameter_mm": 32.0, "strand_lay_mm": 220.0, "wire_lay_mm": -95.0,
        "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "ropeway": "North", "rope": "track rope 1",
        "views": [{"folder": "view0", "angle_deg": 0.0}, {"folder": "view1", "angle_deg": 90.0}],
    });
    std::fs::write(at.join("rope.json"), rope.to_string()).unwrap();
    for view in 0..2 {
        std::fs::create_dir_all(at.join(format!("view{view}"))).unwrap();
        for frame in 0..frames_a_view {
            write_frame(at, view, frame, lines);
        }
    }
}

/// Writes one frame of the recording.
pub fn write_frame(at: &Path, view: usize, frame: usize, lines: u32) {
    let mut state = (view * 1_000_003 + frame) as u64 + 1;
    let noise = std::iter::repeat_with(|| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    });
    let pixels: Vec<u8> = noise.take((SENSOR_PX * lines) as usize).collect();
    std::fs::write(frame_path(at, view, frame), encode_png(SENSOR_PX, lines, &pixels).unwrap()).unwrap();
}

pub fn frame_path(at: &Path, view: usize, frame: usize) -> PathBuf {
    at.join(format!("view{view}/frame_{frame:06}.png"))
}

/// Bytes of all frames of a folder.
pub fn bytes(at: &Path, frames_a_view: usize) -> u64 {
    let paths = (0..2).flat_map(|view| (0..frames_a_view).map(move |frame| frame_path(at, view, frame)));
    paths.map(|path| std::fs::metadata(path).unwrap().len()).sum()
}

/// Asks a service for JSON.
pub fn get(base: &str, token: &str, path: &str) -> Value {
    serde_json::from_str(&get_text(base, token, &format!("/api/v1/{path}"))).unwrap()
}

/// Asks a service for text.
pub fn get_text(base: &str, token: &str, path: &str) -> String {
    answered(token, |client| client.get(format!("{base}{path}")))
}

/// Posts JSON to a service and reads JSON.
pub fn post(base: &str, token: &str, path: &str, body: &Value) -> Value {
    let text = answered(token, |client| client.post(format!("{base}/api/v1/{path}")).json(body));
    serde_json::from_str(&text).unwrap()
}

/// Puts JSON into a service.
pub fn put(base: &str, token: &str, path: &str, body: &Value) {
    answered(token, |client| client.put(format!("{base}/api/v1/{path}")).json(body));
}

/// Sends the first frame of a view.
pub fn put_frame(base: &str, token: &str, acquisition: &str, view: usize, bytes: &[u8]) {
    let path = format!("{base}/api/v1/acquisitions/{acquisition}/views/{view}/frames/0");
    answered(token, |client| client.put(path).body(bytes.to_vec()));
}

/// The body of a good answer.
fn answered(token: &str, request: impl FnOnce(&reqwest::Client) -> reqwest::RequestBuilder) -> String {
    ropescope::tls::install();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let client = reqwest::Client::builder().no_proxy().build().unwrap();
        let answer = request(&client).bearer_auth(token).send().await.unwrap();
        assert!(answer.status().is_success(), "{}: {}", answer.url(), answer.status());
        answer.text().await.unwrap()
    })
}

/// Frames that came although the service held them already (answered 200 instead of 201).
pub fn repeated_frames(base: &str, token: &str) -> u64 {
    let metrics = get_text(base, token, "/metrics");
    let frames = metrics.lines().filter(|line| line.contains("frames/{frame}") && line.contains("status=\"200\""));
    let counts = frames.filter(|line| line.starts_with("ropescope_http_requests_total") && line.contains("PUT"));
    counts.filter_map(|line| line.rsplit(' ').next()?.parse::<u64>().ok()).sum()
}

/// Holds the data folder of a service against the recording: every frame once, byte for byte, and nothing else.
pub fn assert_stored(data: &Path, acquisition: &str, recording: &Path, frames_a_view: usize) {
    assert_frames(data, acquisition, recording, frames_a_view);
    assert_eq!(std::fs::read_dir(data.join("frames")).unwrap().count(), 1, "one acquisition");
}

/// The same where there are other acquisitions.
pub fn assert_frames(data: &Path, acquisition: &str, recording: &Path, frames_a_view: usize) {
    for view in 0..2 {
        let folder = data.join(format!("frames/{acquisition}/{view}"));
        let mut stored: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
        stored.sort();
        assert_eq!(stored.len(), frames_a_view, "view {view}");
        for (frame, path) in stored.iter().enumerate() {
            let equal = std::fs::read(path).unwrap() == std::fs::read(frame_path(recording, view, frame)).unwrap();
            assert!(equal, "{} is not frame {frame} of view {view}", path.display());
        }
    }
    assert_eq!(std::fs::read_dir(data.join("uploads")).unwrap().count(), 0, "nothing half done");
}
