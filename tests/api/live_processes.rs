//! The real program inspects rope that is still arriving: the end is that of an undisturbed run, byte for byte.

use crate::app::Caller;
use crate::process::{Process, token};
use crate::simulated::{caller, complete, frames, open, rope_of, simulated, upload};
use ropescope::simulate::Recipe;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// Every file of an inspection but the summary, which tells how long it took.
fn tables(data: &Path, job: &Value) -> BTreeMap<String, Vec<u8>> {
    fn walk(folder: &Path, root: &Path, files: &mut BTreeMap<String, Vec<u8>>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, root, files);
            } else {
                files.insert(path.strip_prefix(root).unwrap().display().to_string(), std::fs::read(&path).unwrap());
            }
        }
    }
    let inspection = job["result"]["inspection_id"].as_str().unwrap_or_else(|| panic!("{job}"));
    let (root, mut files) = (data.join("inspections").join(inspection), BTreeMap::new());
    walk(&root, &root, &mut files);
    assert!(files.remove("summary.json").is_some() && files.contains_key("lay_lengths.csv"), "{:?}", files.keys());
    files
}

fn assert_same_tables(data: &Path, undisturbed: &Value, live: &Value) {
    let (undisturbed, live) = (tables(data, undisturbed), tables(data, live));
    assert_eq!(undisturbed.keys().collect::<Vec<_>>(), live.keys().collect::<Vec<_>>());
    for (name, bytes) in &undisturbed {
        assert!(&live[name] == bytes, "{name} differs");
    }
}

async fn begin(admin: &Caller, acquisition: &str, model: &Value) -> String {
    let body = json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model, "live": true });
    admin.post("jobs", body).await.ok(202)["id"].as_str().unwrap().to_owned()
}

/// Waits until a job shows so many stretches, and answers them.
async fn rows(admin: &Caller, job: &str, at_least: usize) -> Vec<Value> {
    for _ in 0..2400 {
        let found = admin.get(&format!("jobs/{job}/provisional-lay-lengths")).await.ok(200);
        assert_eq!(found["provisional"], true);
        let rows = found["rows"].as_array().unwrap();
        if rows.len() >= at_least {
            return rows.clone();
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("job {job} shows no {at_least} stretches: {}", admin.get(&format!("jobs/{job}")).await.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn frames_sent_one_at_a_time_with_a_gap_give_results_on_the_way_and_the_same_ones_in_the_end() {
    let recipe = Recipe {
        metres: 3.6,
        view_angles_deg: vec![0.0, 180.0],
        defects: 6,
        defect_free_m: 2.4,
        ..Recipe::photographic()
    };
    let (folder, data) = (simulated(&recipe), tempfile::tempdir().unwrap());
    let token = token(data.path());
    let process = Process::serve(data.path(), 0, &[]);
    let admin = caller(&process, &token);
    let whole = upload(&admin, folder.path()).await;
    let rope = admin.get(&format!("acquisitions/{whole}")).await.ok(200)["rope_id"].clone();
    let trained = admin.run(json!({ "kind": "train", "acquisition_id": whole, "to_m": 2.4 })).await;
    let model = trained["result"]["model_id"].clone();
    let undisturbed = admin.run(json!({ "kind": "inspect", "acquisition_id": whole, "model_id": model })).await;

    let id = open(&admin, folder.path(), &rope).await;
    let job = begin(&admin, &id, &model).await;
    let all = frames(folder.path());
    let last = all.iter().map(|(_, number, _)| *number).max().unwrap();
    assert!(last >= 8, "enough frames to stop in the middle: {last}");
    let send = async |view: u32, number: u32| {
        let frame = all.iter().find(|f| (f.0, f.1) == (view, number)).unwrap();
        admin.put_frame(&id, view, number, frame.2.clone()).await.ok(201);
    };
    // The views one after the other, frame by frame; one frame of the second stays away.
    let gap = last - 2;
    for number in 0..=last {
        send(0, number).await;
        if number != gap {
            send(1, number).await;
        }
    }
    let found = rows(&admin, &job, 6).await;
    let shown = admin.get(&format!("jobs/{job}")).await.ok(200);
    assert_eq!(shown["state"], "running", "it waits for the gap: {shown}");
    let behind_gap = recipe.frame_lines as u64 * u64::from(gap);
    assert!(found.iter().all(|row| row["last_line"].as_u64().unwrap() < behind_gap), "nothing is told behind a gap");
    send(1, gap).await;
    complete(&admin, folder.path(), &id).await;
    let ended = admin.ended(&job).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    assert_same_tables(data.path(), &undisturbed, &ended);

    // What was told on the way is what holds in the end, but for the digits of the tables.
    let inspection = ended["result"]["inspection_id"].as_str().unwrap();
    let holds = admin.get(&format!("inspections/{inspection}/lay-lengths")).await.ok(200);
    for (told, holds) in found.iter().zip(holds["rows"].as_array().unwrap()) {
        assert_eq!((&told["first_line"], &told["last_line"]), (&holds["first_line"], &holds["last_line"]));
        let lay_mm = |row: &Value| row["strand_lay_mm"].as_f64().unwrap();
        assert!((lay_mm(told) - lay_mm(holds)).abs() < 1e-4, "{told} {holds}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_live_job_killed_with_its_worker_process_begins_anew_in_the_next_and_ends_the_same() {
    let recipe = Recipe { metres: 2.4, view_angles_deg: vec![0.0], ..Recipe::photographic() };
    let (folder, data) = (simulated(&recipe), tempfile::tempdir().unwrap());
    let token = token(data.path());
    // Frames are taken by one process and inspected by another, which cannot hear of them but by looking.
    let process = Process::serve(data.path(), 0, &["--no-workers"]);
    let mut worker = Process::begin(&["worker"], data.path());
    let admin = caller(&process, &token);
    let whole = upload(&admin, folder.path()).await;
    let undisturbed = admin.run(json!({ "kind": "inspect", "acquisition_id": whole })).await;

    let rope = rope_of(&admin, folder.path()).await;
    let id = open(&admin, folder.path(), &rope).await;
    let job = begin(&admin, &id, &Value::Null).await;
    let all = frames(folder.path());
    let (last, most) = all.split_last().unwrap();
    for (view, number, bytes) in most {
        admin.put_frame(&id, *view, *number, bytes.clone()).await.ok(201);
    }
    rows(&admin, &job, 5).await;
    worker.kill();
    let _worker = Process::begin(&["worker"], data.path());
    for _ in 0..2400 {
        if admin.get(&format!("jobs/{job}/provisional-lay-lengths")).await.ok(200)["run"] == 2 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(25)).await;
    }
    rows(&admin, &job, 5).await;
    admin.put_frame(&id, last.0, last.1, last.2.clone()).await.ok(201);
    complete(&admin, folder.path(), &id).await;
    let ended = admin.ended(&job).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    assert_same_tables(data.path(), &undisturbed, &ended);
    assert_eq!(
        admin.get("inspections").await.ok(200)["items"].as_array().unwrap().len(),
        2,
        "neither lost nor doubled"
    );
}
