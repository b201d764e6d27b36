//! Backup, restore and scrub as processes beside a service that is in use.

use crate::process::{PROGRAM, Process, token};
use crate::recording::{assert_stored, get, post, put, recording};
use crate::uploader::{Uploader, free_port};
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

const FRAMES: usize = 80;
const WITHIN: Duration = Duration::from_secs(120);

fn run(command: &str, options: &[(&str, &Path)]) -> Output {
    let mut run = Command::new(PROGRAM);
    run.arg(command);
    for (option, path) in options {
        run.arg(option).arg(path);
    }
    run.output().unwrap()
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

#[test]
fn a_backup_made_during_an_upload_comes_back_consistent_and_the_upload_goes_on_there() {
    let [data, source, copies] = [0; 3].map(|_| tempfile::tempdir().unwrap());
    let (backup, restored) = (copies.path().join("backup"), copies.path().join("restored"));
    recording(source.path(), FRAMES, 60);
    let token = token(data.path());
    let mut server = Process::serve(data.path(), free_port(), &[]);
    let mut uploader = Uploader::start(source.path(), &server.base, &token, &["--limit-mbit", "4"]);
    while uploader.held() < 20 {
        assert!(uploader.running());
        std::thread::sleep(Duration::from_millis(10));
    }
    let first = run("backup", &[("--data", data.path()), ("--to", &backup)]);
    assert!(first.status.success(), "{}", text(&first));
    assert!(uploader.running(), "it was made while the upload ran");
    uploader.report(WITHIN);
    // The second one copies what is new. Both are whole.
    let second = run("backup", &[("--data", data.path()), ("--to", &backup)]);
    let held: usize = text(&second).split(" copied, ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((20..2 * FRAMES).contains(&held), "{}", text(&second));
    server.kill();
    let back = run("restore", &[("--from", &backup), ("--data", &restored)]);
    assert!(back.status.success(), "{}", text(&back));
    let again = run("restore", &[("--from", &backup), ("--data", &restored)]);
    assert!(!again.status.success() && text(&again).contains("is not empty"), "{}", text(&again));
    let server = Process::serve(&restored, free_port(), &[]);
    let report = Uploader::start(source.path(), &server.base, &token, &[]).report(WITHIN);
    assert_eq!(report["sent_frames"], 0);
    assert_stored(&restored, report["acquisition_id"].as_str().unwrap(), source.path(), FRAMES);
}

#[test]
fn scrub_finds_what_rotted_and_the_next_upload_heals_it() {
    let [data, source] = [0; 2].map(|_| tempfile::tempdir().unwrap());
    recording(source.path(), 4, 60);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let report = Uploader::start(source.path(), &server.base, &token, &[]).report(WITHIN);
    let id = report["acquisition_id"].as_str().unwrap();
    let scrub = || run("scrub", &[("--data", data.path())]);
    assert!(scrub().status.success(), "{}", text(&scrub()));
    let folder = data.path().join(format!("frames/{id}/1"));
    let rotten = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).max().unwrap();
    let mut bytes = std::fs::read(&rotten).unwrap();
    bytes[99] ^= 4;
    std::fs::write(&rotten, bytes).unwrap();
    let found = scrub();
    assert_eq!(found.status.code(), Some(1));
    assert!(text(&found).contains(&format!("damaged  acquisition {id} view 1 frame 3")), "{}", text(&found));
    assert_eq!(get(&server.base, &token, &format!("acquisitions/{id}/missing"))["views"][1]["damaged"][0], 3);
    let healed = Uploader::start(source.path(), &server.base, &token, &[]).report(WITHIN);
    assert_eq!(healed["sent_frames"], 1);
    assert!(scrub().status.success());
    assert_stored(data.path(), id, source.path(), 4);
}

#[test]
fn retention_says_what_would_go_before_it_goes_and_keeps_what_nobody_has_searched_for_defects() {
    let [data, source] = [0; 2].map(|_| tempfile::tempdir().unwrap());
    let rope = source.path().join("rope");
    // As much as a training needs, half as wide as usual, to be quick.
    let quick = ["--metres", "1.6", "--views", "1", "--sensor-px", "240", "--rope-width-px", "190"];
    let simulate = [&["simulate"][..], &quick[..], &["--seed", "3", "--out"][..]].concat();
    assert!(Command::new(PROGRAM).args(simulate).arg(&rope).output().unwrap().status.success());
    let mut file: Value = serde_json::from_slice(&std::fs::read(rope.join("rope.json")).unwrap()).unwrap();
    file["acquired_at"] = json!("2020-02-02T02:02:02Z");
    std::fs::write(rope.join("rope.json"), file.to_string()).unwrap();
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let report = Uploader::start(&rope, &server.base, &token, &[]).report(WITHIN);
    let (ropeway, id) = (report["ropeway_id"].as_str().unwrap(), report["acquisition_id"].as_str().unwrap());
    put(&server.base, &token, &format!("ropeways/{ropeway}/storage"), &json!({ "keep_days": 30 }));
    let retention = |more: &[&str]| {
        let done = Command::new(PROGRAM).args(["retention", "--data"]).arg(data.path()).args(more).output().unwrap();
        assert!(done.status.success(), "{}", text(&done));
        text(&done)
    };
    let frames = || std::fs::read_dir(data.path().join(format!("frames/{id}/0"))).map_or(0, Iterator::count);
    let said = retention(&[]);
    let stays = |said: &str| said.contains("stays") && said.contains("it was never inspected with a model");
    assert!(stays(&said) && frames() == 8, "{said}");
    let run = |job: Value| {
        let job = post(&server.base, &token, "jobs", &job);
        let job = format!("jobs/{}", job["id"].as_str().unwrap());
        let begun = Instant::now();
        loop {
            let now = get(&server.base, &token, &job);
            if now["state"] == "succeeded" {
                return now["result"].clone();
            }
            assert!(begun.elapsed() < WITHIN && now["state"] != "failed", "{now}");
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    run(json!({ "kind": "inspect", "acquisition_id": id }));
    let said = retention(&[]);
    assert!(stays(&said) && frames() == 8, "lay lengths alone: {said}");
    let model = run(json!({ "kind": "train", "acquisition_id": id }))["model_id"].clone();
    // No score is so high: nothing is found that frames would be evidence of.
    run(json!({ "kind": "inspect", "acquisition_id": id, "model_id": model, "threshold": 1000.0 }));
    let said = retention(&["--dry-run"]);
    assert!(said.contains("would go") && said.contains(id) && frames() == 8, "{said}");
    let said = retention(&[]);
    assert!(said.contains("removed") && frames() == 0, "{said}");
    assert!(get(&server.base, &token, &format!("acquisitions/{id}"))["frames_removed_at"].is_string());
}
