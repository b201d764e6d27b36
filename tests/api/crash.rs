//! The real program, killed without warning.

use crate::app::{Caller, SENSOR_PX, png, png_of};
use crate::process::{Process, token};
use crate::simulated::{caller, simulated, upload};
use ropescope::simulate::Recipe;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

#[tokio::test(flavor = "multi_thread")]
async fn every_acknowledged_frame_survives_kill_9() {
    let data = tempfile::tempdir().unwrap();
    let token = token(data.path());
    let mut process = Process::serve(data.path(), 0, &[]);
    let admin = caller(&process, &token);
    let rope = admin.rope().await;
    let id = admin.acquisition(&rope, &[Some(400)]).await;
    let acknowledged = Arc::new(Mutex::new(Vec::new()));
    let next = Arc::new(AtomicUsize::new(0));
    let senders: Vec<_> = (0..6)
        .map(|_| {
            let (admin, id, acknowledged, next) = (admin.clone(), id.clone(), acknowledged.clone(), next.clone());
            tokio::spawn(async move {
                loop {
                    let n = next.fetch_add(1, Ordering::SeqCst) as u32;
                    if n >= 400 {
                        return;
                    }
                    let path = format!("acquisitions/{id}/views/0/frames/{n}");
                    match admin.request("PUT", &path).body(png_of(SENSOR_PX, 500, n as u8)).send().await {
                        Ok(answer) if answer.status() == 201 => acknowledged.lock().unwrap().push(n),
                        Ok(answer) => panic!("{}", answer.status()),
                        Err(_) => return, // the service is dead
                    }
                }
            })
        })
        .collect();
    while acknowledged.lock().unwrap().len() < 60 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    process.kill();
    for sender in senders {
        sender.await.unwrap();
    }
    let acknowledged = acknowledged.lock().unwrap().clone();
    assert!((60..400).contains(&acknowledged.len()), "{}", acknowledged.len());

    let process = Process::serve(data.path(), 0, &[]);
    let admin = caller(&process, &token);
    for n in &acknowledged {
        let back = admin.get(&format!("acquisitions/{id}/views/0/frames/{n}")).await;
        assert_eq!(back.status, 200, "frame {n} was acknowledged and is gone");
        assert!(back.bytes == png_of(SENSOR_PX, 500, *n as u8), "frame {n} came back changed");
    }
    // Nothing half-done is left, and the upload goes on where it was: frames are there or not, never twice.
    assert_eq!(std::fs::read_dir(data.path().join("uploads")).unwrap().count(), 0);
    let present = admin.get(&format!("acquisitions/{id}")).await.ok(200)["frames_present"].as_u64().unwrap() as usize;
    let files = std::fs::read_dir(data.path().join(format!("frames/{id}/0"))).unwrap().count();
    assert_eq!(files, present);
    assert!(present >= acknowledged.len());
    for n in 0..400 {
        let answer = admin.put_frame(&id, 0, n, png_of(SENSOR_PX, 500, n as u8)).await;
        assert!([200, 201].contains(&answer.status));
    }
    admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_service_says_where_it_listens_and_goes_down_in_order() {
    let data = tempfile::tempdir().unwrap();
    let token = token(data.path());
    let mut process = Process::serve(data.path(), 0, &[]);
    let admin = caller(&process, &token);
    let id = admin.acquisition(&admin.rope().await, &[Some(1)]).await;
    admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let pid = process.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    assert!(process.child.wait().unwrap().success());
    assert_eq!(std::fs::read_dir(data.path().join("instances")).unwrap().count(), 0);
}

/// Four metres of intact rope in one view: two were done within the third of a second before the kill.
fn recipe() -> Recipe {
    Recipe { metres: 4.0, view_angles_deg: vec![0.0], ..Recipe::photographic() }
}

/// Runs the same job twice on a service with that acquisition, killing the process in the middle of the second run. Answers
/// the service that was started anew, and both jobs at their ends: undisturbed and disturbed.
async fn run_undisturbed_and_killed(folder: &Path, data: &Path, kind: &str) -> (Process, Caller, [Value; 2]) {
    let token = token(data);
    let mut process = Process::serve(data, 0, &[]);
    let admin = caller(&process, &token);
    let body = json!({ "kind": kind, "acquisition_id": upload(&admin, folder).await });
    let undisturbed = admin.run(body.clone()).await;
    let job = admin.post("jobs", body).await.ok(202);
    let id = job["id"].as_str().unwrap().to_owned();
    admin.reached(&id, "running").await;
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert_eq!(admin.get(&format!("jobs/{id}")).await.ok(200)["state"], "running", "killed too late to prove anything");
    process.kill();

    let process = Process::serve(data, 0, &[]);
    let admin = caller(&process, &token);
    let disturbed = admin.ended(&id).await;
    assert_eq!(disturbed["state"], "succeeded", "{disturbed}");
    (process, admin, [undisturbed, disturbed])
}

#[tokio::test(flavor = "multi_thread")]
async fn an_inspection_killed_with_its_process_ends_with_the_same_result_as_an_undisturbed_one() {
    let (folder, data) = (simulated(&recipe()), tempfile::tempdir().unwrap());
    let (_process, admin, jobs) = run_undisturbed_and_killed(folder.path(), data.path(), "inspect").await;
    let mut tables = Vec::new();
    for job in &jobs {
        let inspection = job["result"]["inspection_id"].as_str().unwrap();
        tables.push(admin.get(&format!("inspections/{inspection}/lay-lengths?format=csv")).await.text());
    }
    assert!(tables[0] == tables[1], "the results differ");
    let all = admin.get("inspections").await.ok(200);
    assert_eq!(all["items"].as_array().unwrap().len(), 2, "the job was neither lost nor doubled");
}

/// Header and packed tables of a model file. The header tells how many seconds the training took, which no two runs share.
fn model_parts(file: &[u8]) -> (Value, &[u8]) {
    // The first line tells the version.
    let begin = file.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    let rest = &file[begin..];
    let (length, rest) = rest.split_first_chunk::<4>().unwrap();
    let (header, tables) = rest.split_at(u32::from_le_bytes(*length) as usize);
    let mut header: Value = serde_json::from_slice(header).unwrap();
    assert!(header["report"].as_object_mut().unwrap().remove("seconds").unwrap().is_number());
    (header, tables)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_training_killed_with_its_process_leaves_one_model_and_the_same_as_an_undisturbed_one() {
    let (folder, data) = (simulated(&recipe()), tempfile::tempdir().unwrap());
    let (_process, admin, jobs) = run_undisturbed_and_killed(folder.path(), data.path(), "train").await;
    let models = admin.get("models").await.ok(200);
    let models = models["items"].as_array().unwrap();
    assert_eq!(models.len(), 2, "the job was neither lost nor doubled");
    let mut files = Vec::new();
    for (job, version) in jobs.iter().zip(1..) {
        let id = job["result"]["model_id"].as_str().unwrap();
        let model = models.iter().find(|m| m["id"] == id).unwrap();
        assert_eq!((&model["job_id"], &model["version"]), (&job["id"], &json!(version)));
        let file = admin.get(&format!("models/{id}/file")).await;
        assert_eq!(model["bytes"], file.bytes.len());
        files.push(file.bytes);
    }
    let [undisturbed, disturbed] = [&files[0], &files[1]].map(|file| model_parts(file));
    assert_eq!(disturbed.0, undisturbed.0, "the models say different things of themselves");
    assert!(disturbed.1 == undisturbed.1, "the models judge differently");
    // What the killed attempt wrote is gone: no third model lies on the disk, and no half one.
    for (folder, files) in [("models", 2), ("work", 0)] {
        assert_eq!(std::fs::read_dir(data.path().join(folder)).unwrap().count(), files, "{folder}");
    }
}
