//! The stages of the demo: simulate, upload, run a job; each says what it did in a line.

use super::{ROPE, ROPEWAY};
use anyhow::{Context, bail};
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use ropescope::upload::{Client, Names, Options, Plan, upload};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Shortest time between two lines about a running job.
const LINE_EVERY: Duration = Duration::from_secs(3);
/// Time between two looks at a running job.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Writes an acquisition into `folder/name` and dates it.
pub(super) fn simulate(name: &str, recipe: Recipe, seed: u64, folder: &Path, at: &str) -> anyhow::Result<PathBuf> {
    let begun = Instant::now();
    let out = folder.join(name);
    let scene = Scene::new(&recipe, seed)?;
    write_acquisition(&scene, &out, |_| {})?;
    let path = out.join("rope.json");
    let mut rope: Value = serde_json::from_slice(&std::fs::read(&path)?)?;
    rope["acquired_at"] = json!(at);
    std::fs::write(&path, serde_json::to_vec_pretty(&rope)?).with_context(|| path.display().to_string())?;
    println!(
        "simulate    {name}: {} m, {} views, {} defects in {:.1} s",
        recipe.metres,
        scene.views(),
        recipe.defects,
        begun.elapsed().as_secs_f64()
    );
    Ok(out)
}

/// Uploads a folder over HTTP; returns the id of the acquisition.
pub(super) async fn upload_folder(client: &Client, folder: &Path) -> anyhow::Result<String> {
    let names = Names { ropeway: Some(ROPEWAY.into()), rope: Some(ROPE.into()) };
    let plan = Plan::read(folder, &names)?;
    let report = upload(client, &plan, &Options::default(), |_| {}).await?;
    let mb = report.sent_bytes as f64 / 1e6;
    println!(
        "upload      {}: {} frames, {mb:.1} MB in {:.1} s ({:.0} MB/s)",
        folder.file_name().unwrap_or_default().to_string_lossy(),
        report.sent_frames,
        report.seconds,
        mb / report.seconds.max(1e-9)
    );
    Ok(report.acquisition_id.to_string())
}

/// Runs a job to its end and returns its result.
pub(super) async fn job(client: &Client, name: &str, request: &Value) -> anyhow::Result<Value> {
    let begun = Instant::now();
    let mut job = client.post("/jobs", request).await?;
    let path = format!("/jobs/{}", job["id"].as_str().unwrap_or_default());
    let mut said = Instant::now();
    loop {
        match job["state"].as_str().unwrap_or_default() {
            "succeeded" => break,
            "queued" | "running" => {}
            state => bail!("the job {name} {state}: {}", job["error"]["detail"].as_str().unwrap_or("no reason given")),
        }
        if said.elapsed() >= LINE_EVERY && job["progress"]["total_m"].is_number() {
            said = Instant::now();
            let (stage, progress) = (job["progress"]["stage"].as_str().unwrap_or(name), &job["progress"]);
            let (done_m, total_m) = (number(&progress["done_m"]), number(&progress["total_m"]));
            println!("{name:<11} {stage}: {done_m:.1} of {total_m:.1} m, {:.2} m/s", number(&job["metres_per_second"]));
        }
        tokio::time::sleep(LOOK_EVERY).await;
        job = client.get(&path).await?;
    }
    println!("{name:<11} done in {:.1} s", begun.elapsed().as_secs_f64());
    Ok(job["result"].clone())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(0.0)
}
