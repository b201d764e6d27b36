//! How soon results appear while an upload still runs: `ropescope serve` as a process, frames sent to a live inspection one number of
//! all views after the other over a link of 20 Mbit/s, first without and then with a model. For every stretch of rope: the seconds from the
//! acknowledgement of the last frame needed until its lay lengths can be read over the API, until they came as a server-sent event, and,
//! with a model, until the first defect in it can be read.
//!
//! ```text
//! cargo bench --bench live             5 m of rope in four views
//! cargo bench --bench live -- --quick  3 m
//! ```
//!
//! Fails if a stretch was told before the frames that it needs: then this bench does not know which those are.

#![allow(clippy::unwrap_used, reason = "the process is shared with tests, whose failed expectations may panic")]

#[path = "../tests/shared/process.rs"]
mod process;

use anyhow::{Context, ensure};
use futures::StreamExt;
use process::{Process, token};
use reqwest::Method;
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use ropescope::upload::{Client, Names, Options, Plan, upload};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How soon a stretch should be readable.
const TARGET_S: f64 = 2.0;
const LINK_MBIT_S: f64 = 20.0;
/// Stretches that are gathered before the rope is searched.
const GATHERED: usize = 5;
/// Stretches behind the end of another that are needed to tell it: its neighbour, measured with its own neighbour's contours in sight,
/// and half of the one that follows, because a short rest of the rope is joined to the last stretch.
const NEEDED_BEHIND: f64 = 2.5;
/// Time between two looks over the API.
const LOOK: Duration = Duration::from_millis(40);

/// What became readable when, by the first line of its stretch (of a defect: by its first line).
type Seen = Arc<Mutex<BTreeMap<u64, Told>>>;

/// When a stretch or a defect was first told.
#[derive(Clone, Copy)]
struct Told {
    last_line: u64,
    when: Instant,
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let metres = if std::env::args().any(|arg| arg == "--quick") { 3.0 } else { 5.0 };
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR"))?;
    let (intact, damaged, data) =
        (folder.path().join("intact"), folder.path().join("damaged"), folder.path().join("data"));
    println!("simulating 2 m of intact and {metres} m of damaged rope");
    simulate(&intact, 2.0, 0, 1)?;
    simulate(&damaged, metres, metres as usize * 3, 2)?;

    ropescope::tls::install();
    let token = token(&data);
    let mut server = Process::serve(&data, 0, &[]);
    let client = Client::new(&server.base, &token, Duration::from_secs(60), 1)?;
    let whole = upload(&client, &Plan::read(&intact, &Names::default())?, &Options::default(), |_| {}).await?;
    let train = client.post("/jobs", &json!({"kind": "train", "acquisition_id": whole.acquisition_id})).await?;
    let trained = ended(&client, &train).await?;
    ensure!(trained["state"] == "succeeded", "the training failed: {trained}");
    let bench = Bench { client, token, base: server.base.clone(), rope: json!(whole.rope_id), damaged };
    bench.run("without a model", &Value::Null).await?;
    bench.run("with a model", &trained["result"]["model_id"]).await?;
    server.kill();
    Ok(())
}

fn simulate(to: &Path, metres: f64, defects: usize, seed: u64) -> anyhow::Result<()> {
    let recipe = Recipe { metres, defects, ..Recipe::photographic() };
    write_acquisition(&Scene::new(&recipe, seed)?, to, |_| {})?;
    Ok(())
}

/// Waits for a job.
async fn ended(client: &Client, job: &Value) -> anyhow::Result<Value> {
    let path = format!("/jobs/{}", text(&job["id"])?);
    loop {
        let job = client.get(&path).await?;
        if !["queued", "running"].contains(&text(&job["state"])?) {
            return Ok(job);
        }
        tokio::time::sleep(LOOK).await;
    }
}

fn text(value: &Value) -> anyhow::Result<&str> {
    value.as_str().with_context(|| format!("{value} is no text"))
}

/// A service that knows the rope and has a model of it.
struct Bench {
    client: Client,
    token: String,
    base: String,
    rope: Value,
    damaged: std::path::PathBuf,
}

impl Bench {
    async fn run(&self, what: &str, model: &Value) -> anyhow::Result<()> {
        let plan = Plan::read(&self.damaged, &Names::default())?;
        let rope = text(&self.rope)?.parse()?;
        let acquisition = self.client.post("/acquisitions", &plan.acquisition(rope)).await?;
        let acquisition = text(&acquisition["id"])?.to_owned();
        let body = json!({"kind": "inspect", "acquisition_id": acquisition, "model_id": model, "live": true});
        let job = self.client.post("/jobs", &body).await?;
        let id = text(&job["id"])?.to_owned();
        let [over_api, over_events, defects] = [0; 3].map(|_| Seen::default());
        let watchers = [
            tokio::spawn(poll(self.client.clone(), id.clone(), "provisional-lay-lengths", over_api.clone())),
            tokio::spawn(poll(self.client.clone(), id.clone(), "provisional-defects", defects.clone())),
            tokio::spawn(listen(self.base.clone(), self.token.clone(), id, over_events.clone())),
        ];
        let acknowledged = self.send(&plan, &acquisition).await?;
        let completed = Instant::now();
        let done = ended(&self.client, &job).await?;
        let end_s = completed.elapsed().as_secs_f64();
        watchers.iter().for_each(tokio::task::JoinHandle::abort);
        ensure!(done["state"] == "succeeded", "the inspection failed: {done}");
        let [over_api, over_events, defects] = [over_api, over_events, defects].map(|seen| whole(&seen));
        print(what, &acknowledged, &over_api, &over_events, &defects)?;
        println!("from the completion to the end of the job {end_s:.2} s\n");
        Ok(())
    }

    /// Sends the frames, one number of all views after the other, and completes. Answers the last line and the time of
    /// acknowledgement of each number.
    async fn send(&self, plan: &Plan, acquisition: &str) -> anyhow::Result<Vec<(u64, Instant)>> {
        let link = self.client.clone().limited_to(LINK_MBIT_S * 1e6 / 8.0);
        let numbers = plan.frames.iter().map(Vec::len).min().unwrap_or(0);
        let (mut acknowledged, mut lines) = (Vec::new(), 0);
        for number in 0..numbers {
            let mut of_this_number = 0;
            for (view, frames) in plan.frames.iter().enumerate() {
                let path = format!("/acquisitions/{acquisition}/views/{view}/frames/{number}");
                let headers = [("content-type", "image/png".to_owned())];
                let body = tokio::fs::read(&frames[number].path).await?;
                let stored = link.send(Method::PUT, &path, &headers, body.into()).await?;
                of_this_number = serde_json::from_slice::<Value>(&stored.body)?["lines"].as_u64().unwrap_or(0);
            }
            lines += of_this_number;
            acknowledged.push((lines, Instant::now()));
        }
        self.client.post(&format!("/acquisitions/{acquisition}/completion"), &plan.completion()).await?;
        Ok(acknowledged)
    }
}

/// Looks again and again at what a job has found, until the job has ended.
async fn poll(client: Client, job: String, what: &'static str, seen: Seen) -> anyhow::Result<()> {
    loop {
        let found = client.get(&format!("/jobs/{job}/{what}")).await?;
        note(&seen, &found);
        tokio::time::sleep(LOOK).await;
    }
}

/// Follows the events of a job.
async fn listen(base: String, token: String, job: String, seen: Seen) -> anyhow::Result<()> {
    let http = reqwest::Client::builder().no_proxy().build()?;
    let answer = http.get(format!("{base}/api/v1/jobs/{job}/events")).bearer_auth(token).send().await?;
    let (mut stream, mut pending) = (answer.bytes_stream(), Vec::new());
    while let Some(piece) = stream.next().await {
        pending.extend_from_slice(&piece?);
        while let Some(end) = pending.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = pending.drain(..=end).collect();
            if let Some(data) = line.strip_prefix(b"data:") {
                note(&seen, &serde_json::from_slice(data)?);
            }
        }
    }
    Ok(())
}

/// Notes stretches and defects that were not told before.
fn note(seen: &Seen, found: &Value) {
    let when = Instant::now();
    let mut seen = seen.lock().unwrap();
    for row in found["rows"].as_array().into_iter().flatten() {
        if let (Some(first_line), Some(last_line)) = (row["first_line"].as_u64(), row["last_line"].as_u64()) {
            seen.entry(first_line).or_insert(Told { last_line, when });
        }
    }
    for alarm in found["defects"].as_array().into_iter().flatten().flat_map(|d| d["alarms"].as_array()).flatten() {
        if let (Some(first_line), Some(last_line)) = (alarm["first_line"].as_u64(), alarm["last_line"].as_u64()) {
            seen.entry(first_line).or_insert(Told { last_line, when });
        }
    }
}

fn whole(seen: &Seen) -> BTreeMap<u64, Told> {
    seen.lock().unwrap().clone()
}

fn print(
    what: &str,
    acknowledged: &[(u64, Instant)],
    over_api: &BTreeMap<u64, Told>,
    over_events: &BTreeMap<u64, Told>,
    defects: &BTreeMap<u64, Told>,
) -> anyhow::Result<()> {
    println!("{what}; target: {TARGET_S:.1} s");
    println!("{:>7}  {:>13}  {:>6}  {:>6}  {:>6}", "stretch", "lines", "API", "events", "defect");
    let stretches: Vec<(u64, Told)> = over_api.iter().map(|(&first, &told)| (first, told)).collect();
    ensure!(stretches.len() > GATHERED, "only {} stretches were told before the end", stretches.len());
    for (n, (first_line, told)) in stretches.iter().enumerate() {
        let stretch_lines = (stretches[0].1.last_line + 1) as f64;
        let settled_by = stretches[n.max(GATHERED - 2)].1.last_line + 1;
        let needed = settled_by + (NEEDED_BEHIND * stretch_lines) as u64;
        let last = acknowledged.iter().find(|(lines, _)| *lines >= needed);
        let Some((_, from)) = last else {
            println!("{n:>7}  told by the completion");
            continue;
        };
        // The answer of a PUT and the rows it brings overtake each other by a moment.
        let seconds = |told: &Told| told.when.saturating_duration_since(*from).as_secs_f64();
        ensure!(
            told.when + Duration::from_millis(50) > *from,
            "stretch {n} was told before line {needed} was acknowledged"
        );
        let events = over_events.get(first_line).map_or_else(String::new, |told| format!("{:.2}", seconds(told)));
        let defect = defects.range(*first_line..=told.last_line).map(|(_, told)| seconds(told)).reduce(f64::min);
        let defect = defect.map_or_else(String::new, |seconds| format!("{seconds:.2}"));
        let slow = if seconds(told) > TARGET_S { "  slower than the target" } else { "" };
        let lines = format!("{first_line}-{}", told.last_line);
        println!("{n:>7}  {lines:>13}  {:>6.2}  {events:>6}  {defect:>6}{slow}", seconds(told));
    }
    Ok(())
}
