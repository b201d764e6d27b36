//! How fast a service takes frames on loopback, digests and syncs included: `ropescope upload` with eight connections against
//! `ropescope serve`, both as processes of the release binary, beside what the same disk takes from plain writes with a sync per 8 MB.
//!
//! ```text
//! cargo bench --bench ingest             400 frames of 1 MB
//! cargo bench --bench ingest -- --quick  60 frames
//! ```

use anyhow::{Context, ensure};
use ropescope::simulate::write::encode_png;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

/// What should be reached, in MB/s, or ..
const TARGET_MB_PER_S: f64 = 150.0;
/// .. this share of what the disk takes, whichever is lower.
const TARGET_SHARE: f64 = 0.8;
/// What the service may need, in MB.
const TARGET_MB: f64 = 200.0;
const SENSOR_PX: u32 = 500;
const LINES: u32 = 2000;
const SYNC_EVERY: usize = 8 << 20;

fn main() -> anyhow::Result<()> {
    let frames = if std::env::args().any(|arg| arg == "--quick") { 60 } else { 400 };
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR"))?;
    let (recording, data) = (folder.path().join("recording"), folder.path().join("data"));
    let megabytes = record(&recording, frames)? as f64 / 1e6;
    let disk = plain_writes(&folder.path().join("plain"), &recording, frames)?;

    let token = token(&data)?;
    let (server, address) = serve(&data)?;
    let begun = Instant::now();
    let report = upload(&recording, &address, &token);
    let speed = megabytes / begun.elapsed().as_secs_f64();
    let peak_mb = peak_rss_kb(&server).unwrap_or(0) as f64 / 1000.0;
    stop(server)?;
    ensure!(report?["sent_frames"] == frames, "not all frames were sent");

    let target = TARGET_MB_PER_S.min(TARGET_SHARE * disk);
    let slow = if speed < target { "  below the target speed" } else { "" };
    let large = if peak_mb > TARGET_MB { "  above the target memory" } else { "" };
    println!("{frames} frames, {megabytes:.0} MB; targets: {target:.0} MB/s, below {TARGET_MB} MB");
    println!("plain writes with a sync per 8 MB  {disk:>6.0} MB/s");
    println!("ingest over 8 connections          {speed:>6.0} MB/s, {peak_mb:.0} MB of memory{slow}{large}");
    Ok(())
}

/// Writes a recording of one view with noise, which does not compress. Returns its bytes.
fn record(folder: &Path, frames: usize) -> anyhow::Result<u64> {
    std::fs::create_dir_all(folder.join("view0"))?;
    let rope = json!({
        "strands": 6, "wires_per_strand": 9, "rope_diameter_mm": 32.0, "strand_lay_mm": 220.0, "wire_lay_mm": -95.0,
        "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "views": [{"folder": "view0", "angle_deg": 0.0}],
    });
    std::fs::write(folder.join("rope.json"), rope.to_string())?;
    let mut bytes = 0;
    let mut state = 1_u64;
    for frame in 0..frames {
        let noise = std::iter::repeat_with(|| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        });
        let pixels: Vec<u8> = noise.take((SENSOR_PX * LINES) as usize).collect();
        let png = encode_png(SENSOR_PX, LINES, &pixels)?;
        bytes += png.len() as u64;
        std::fs::write(folder.join(format!("view0/frame_{frame:06}.png")), png)?;
    }
    Ok(bytes)
}

/// MB/s of writing the same bytes into one file.
fn plain_writes(to: &Path, recording: &Path, frames: usize) -> anyhow::Result<f64> {
    let mut file = File::create(to)?;
    let (mut bytes, mut unsynced, mut seconds) = (0, 0, 0.0);
    for frame in 0..frames {
        let content = std::fs::read(recording.join(format!("view0/frame_{frame:06}.png")))?;
        let begun = Instant::now();
        file.write_all(&content)?;
        unsynced += content.len();
        if unsynced >= SYNC_EVERY || frame + 1 == frames {
            file.sync_data()?;
            unsynced = 0;
        }
        seconds += begun.elapsed().as_secs_f64();
        bytes += content.len();
    }
    Ok(bytes as f64 / 1e6 / seconds)
}

fn ropescope() -> Command {
    Command::new(env!("CARGO_BIN_EXE_ropescope"))
}

fn token(data: &Path) -> anyhow::Result<String> {
    let made = ropescope().args(["token", "create", "--role", "admin", "--data"]).arg(data).output()?;
    let text = String::from_utf8(made.stdout)?;
    text.lines().last().map(str::to_owned).context("no token was made")
}

fn serve(data: &Path) -> anyhow::Result<(Child, String)> {
    let mut server = ropescope();
    server.args(["serve", "--no-workers", "--listen", "127.0.0.1:0", "--data"]).arg(data).env("RUST_LOG", "warn");
    let mut server = server.stdout(Stdio::piped()).spawn()?;
    let mut line = String::new();
    BufReader::new(server.stdout.take().context("no output")?).read_line(&mut line)?;
    let address = line.trim().strip_prefix("listening on ").context("the service did not start")?.to_owned();
    Ok((server, address))
}

fn upload(recording: &Path, address: &str, token: &str) -> anyhow::Result<Value> {
    let mut upload = ropescope();
    upload.arg("upload").arg(recording).args(["--json", "--connections", "8", "--server", address]);
    let done = upload.env("ROPESCOPE_TOKEN", token).output()?;
    ensure!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let text = String::from_utf8(done.stdout)?;
    Ok(serde_json::from_str(text.lines().last().unwrap_or_default())?)
}

fn stop(mut server: Child) -> anyhow::Result<()> {
    server.kill()?;
    server.wait()?;
    Ok(())
}

/// High-water mark of the resident memory, as Linux counts it.
fn peak_rss_kb(child: &Child) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}
