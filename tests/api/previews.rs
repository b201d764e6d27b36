//! Reduced forms of frames, sent before them: what is taken, what becomes of it, and that none of it lasts.

use crate::app::{Answer, Caller, TestApp, png, png_of};
use ropescope::store::tokens::Role;
use serde_json::{Value, json};
use std::time::Duration;

/// Columns of the sensor: a quarter of them are those of the toy's frames.
const SENSOR_PX: u32 = 256;
/// Lines of a frame; its preview has a hundred.
const LINES: u32 = 400;
const FRAMES: u32 = 8;

/// An open acquisition of one view whose frames are announced.
async fn announced(admin: &Caller) -> String {
    let rope = admin.rope().await;
    let views = json!([{ "angle_deg": 0.0, "frames": FRAMES }]);
    let body = json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "views": views, "start_m": 5.0 });
    let id = admin.post("acquisitions", body).await.ok(201)["id"].as_str().unwrap().to_owned();
    announce(admin, &id, 0..FRAMES).await;
    id
}

async fn announce(admin: &Caller, id: &str, frames: std::ops::Range<u32>) {
    use sha2::{Digest, Sha256};
    let frame = |n: u32| {
        let bytes = png_of(SENSOR_PX, LINES, n as u8);
        let sha256: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        json!({ "view": 0, "frame": n, "sha256": sha256, "bytes": bytes.len(), "lines": LINES })
    };
    let frames: Vec<Value> = frames.map(frame).collect();
    admin.post(&format!("acquisitions/{id}/manifest"), json!({ "frames": frames })).await.ok(200);
}

async fn put(caller: &Caller, id: &str, frame: u32, bytes: Vec<u8>) -> Answer {
    let path = format!("acquisitions/{id}/views/0/previews/{frame}");
    caller.send(caller.request("PUT", &path).header("content-type", "image/png").body(bytes)).await
}

async fn complete(admin: &Caller, id: &str) {
    for n in 0..FRAMES {
        let answer = admin.put_frame(id, 0, n, png_of(SENSOR_PX, LINES, n as u8)).await;
        assert!(matches!(answer.status, 200 | 201), "{}", answer.text());
    }
    admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
}

async fn wanted(admin: &Caller, id: &str) -> Vec<u64> {
    let answer = admin.get(&format!("acquisitions/{id}/wanted")).await.ok(200);
    answer["frames"].as_array().unwrap().iter().map(|f| f["frame"].as_u64().unwrap()).collect()
}

async fn job_of(admin: &Caller, id: &str) -> String {
    let previews = admin.get(&format!("acquisitions/{id}/previews")).await.ok(200);
    previews["job_id"].as_str().unwrap_or_else(|| panic!("{previews}")).to_owned()
}

fn files(app: &TestApp) -> usize {
    fn below(path: &std::path::Path) -> usize {
        let Ok(entries) = std::fs::read_dir(path) else { return 1 };
        entries.map(|e| below(&e.unwrap().path())).sum()
    }
    below(&app.data.path().join("previews"))
}

#[tokio::test(flavor = "multi_thread")]
async fn previews_are_looked_at_as_they_come_and_say_which_frames_are_wanted_first_but_are_no_result() {
    let app = TestApp::start().await;
    let id = announced(&app.admin).await;
    assert_eq!(wanted(&app.admin, &id).await, (0..8).collect::<Vec<_>>(), "without previews in turn");
    put(&app.admin, &id, 0, png(0)).await.ok(201);
    put(&app.admin, &id, 0, png(0)).await.ok(200);
    let job = job_of(&app.admin, &id).await;
    let lays = format!("jobs/{job}/provisional-lay-lengths");
    let mut found = Value::Null;
    for _ in 0..400 {
        found = app.admin.get(&lays).await.ok(200);
        if found["rows"].as_array().unwrap().len() == 1 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(25)).await;
    }
    let lines = (found["rows"][0]["first_line"].clone(), found["rows"][0]["last_line"].clone());
    assert_eq!(lines, (json!(0), json!(LINES - 1)), "in lines of the camera, not of previews: {found}");
    let shown = app.admin.get(&format!("acquisitions/{id}/previews")).await.ok(200);
    assert_eq!((&shown["views"][0]["present"], &shown["views"][0]["missing"]), (&json!(1), &json!([[1, 7]])));

    for n in 1..FRAMES {
        put(&app.admin, &id, n, png(n as u8)).await.ok(201);
    }
    let ended = app.admin.ended(&job).await;
    assert_eq!(
        (&ended["state"], &ended["preview"], &ended["result"]),
        (&json!("succeeded"), &json!(true), &Value::Null)
    );
    assert_eq!(app.admin.get(&lays).await.ok(200)["rows"].as_array().unwrap().len(), 8, "it stays for now");
    // The toy's scores are highest in frame 0, then in frame 2; a quarter of eight comes first.
    assert_eq!(wanted(&app.admin, &id).await, [0, 2, 1, 3, 4, 5, 6, 7]);
    let first = app.admin.get(&format!("acquisitions/{id}/wanted?limit=1")).await.ok(200)["frames"][0].clone();
    assert_eq!((&first["suspicion"], &first["from_m"], &first["to_m"]), (&json!(1.5), &json!(5.0), &json!(5.04)));
    assert_eq!(first["reason"], "it looks unlike the rest");
    app.admin.put_frame(&id, 0, 0, png_of(SENSOR_PX, LINES, 0)).await.ok(201);
    assert_eq!(wanted(&app.admin, &id).await[0], 2, "what is there is not wanted");
    for list in ["inspections", "models"] {
        assert_eq!(app.admin.get(list).await.ok(200)["items"], json!([]), "{list}");
    }
    assert_eq!(
        app.admin.get(&format!("acquisitions/{id}")).await.ok(200)["frames_present"],
        1,
        "previews are no frames"
    );

    complete(&app.admin, &id).await;
    assert_eq!((wanted(&app.admin, &id).await.len(), files(&app)), (0, 0));
    app.admin.get(&lays).await.problem(410, "provisional-gone");
    assert_eq!(app.admin.get(&format!("acquisitions/{id}/previews")).await.ok(200)["bytes"], 0);
    put(&app.admin, &id, 0, png(0)).await.problem(409, "acquisition-complete");
}

#[tokio::test]
async fn what_is_no_preview_of_its_frame_is_refused_and_nothing_is_stored() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let id = announced(&app.admin).await;
    let wrong = put(&app.admin, &id, 0, png_of(SENSOR_PX, LINES, 0)).await.problem(422, "preview-wrong-size");
    assert_eq!((&wrong["value"]["columns"], &wrong["limit"]["columns"]), (&json!(256), &json!(64)));
    put(&app.admin, &id, 0, png_of(64, 101, 0)).await.problem(422, "preview-wrong-size");
    let cut = png(0);
    put(&app.admin, &id, 0, cut[..cut.len() / 2].to_vec()).await.problem(422, "frame-unreadable");
    put(&app.admin, &id, FRAMES, png(0)).await.problem(404, "frame-out-of-range");
    let path = format!("acquisitions/{id}/views/0/previews/0");
    let digest = "sha-256=:RBNvo1WzZ4oRRq0W9+hknpT7T8If536DEMBg9hyq/4o=:";
    let request = app.admin.request("PUT", &path).header("repr-digest", digest).body(png(0));
    app.admin.send(request).await.problem(422, "digest-mismatch");
    let reader = app.caller(Role::Read).await;
    put(&reader, &id, 0, png(0)).await.problem(403, "forbidden");
    assert_eq!((files(&app), app.admin.get("jobs").await.ok(200)["items"].as_array().unwrap().len()), (0, 0));

    let uploader = app.caller(Role::Upload).await;
    put(&uploader, &id, 0, png(0)).await.ok(201);
    put(&uploader, &id, 0, png(1)).await.problem(409, "frame-differs");
    assert_eq!(files(&app), 1);

    // Nobody knows where the preview of a frame begins before those before it are announced.
    let rope = app.admin.get("ropes").await.ok(200)["items"][0]["id"].clone();
    let open = |sensor_px: u32| json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": sensor_px, "views": [{ "angle_deg": 0.0 }] });
    let other = app.admin.post("acquisitions", open(SENSOR_PX)).await.ok(201)["id"].as_str().unwrap().to_owned();
    announce(&app.admin, &other, 1..3).await;
    put(&app.admin, &other, 1, png(1)).await.problem(409, "frame-not-announced");
    let narrow = app.admin.post("acquisitions", open(255)).await.ok(201)["id"].as_str().unwrap().to_owned();
    put(&app.admin, &narrow, 0, png(1)).await.problem(422, "preview-wrong-size");
    assert_eq!(files(&app), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_still_looks_at_previews_ends_with_the_completion_and_keeps_nobody_from_deleting() {
    let app = TestApp::start().await;
    let id = announced(&app.admin).await;
    put(&app.admin, &id, 0, png(0)).await.ok(201);
    let job = job_of(&app.admin, &id).await;
    app.admin.reached(&job, "running").await;
    complete(&app.admin, &id).await;
    let ended = app.admin.ended(&job).await;
    assert_eq!((&ended["state"], &ended["error"]), (&json!("cancelled"), &Value::Null));
    app.admin.get(&format!("jobs/{job}/provisional-lay-lengths")).await.problem(410, "provisional-gone");
    app.admin.send(app.admin.request("DELETE", &format!("acquisitions/{id}"))).await.ok_status(204);
    app.admin.get(&format!("jobs/{job}")).await.problem(404, "not-found");

    // Also while it waits for more.
    let id = announced(&app.admin).await;
    put(&app.admin, &id, 0, png(0)).await.ok(201);
    app.admin.reached(&job_of(&app.admin, &id).await, "running").await;
    app.admin.send(app.admin.request("DELETE", &format!("acquisitions/{id}"))).await.ok_status(204);
    assert_eq!(files(&app), 0);
}

#[tokio::test]
async fn previews_of_an_acquisition_that_nobody_completes_go_after_the_time_of_its_ropeway() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let id = announced(&app.admin).await;
    put(&app.admin, &id, 0, png(0)).await.ok(201);
    let ropeway = app.admin.get("ropeways").await.ok(200)["items"][0]["id"].as_str().unwrap().to_owned();
    app.admin.call("PUT", &format!("ropeways/{ropeway}/storage"), json!({ "keep_days": 10 })).await.ok(200);
    let (store, now_ms) = (&app.service.app.store, app.service.app.now_ms());
    let later_ms = now_ms + 11 * 86_400_000;
    assert_eq!(store.remove_overdue_previews(now_ms, false).await.unwrap().0, 0);
    assert_eq!((store.remove_overdue_previews(later_ms, true).await.unwrap().0, files(&app)), (1, 1), "only said");
    assert_eq!((store.remove_overdue_previews(later_ms, false).await.unwrap().0, files(&app)), (1, 0));
    assert_eq!(app.admin.ended(&job_of(&app.admin, &id).await).await["state"], "cancelled");
}

#[tokio::test]
async fn a_preview_without_a_row_is_swept_and_a_copy_of_the_data_has_none() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let id = announced(&app.admin).await;
    put(&app.admin, &id, 0, png(0)).await.ok(201);
    let folder = app.data.path().join(format!("previews/{id}/0"));
    std::fs::write(folder.join("000001-0000"), b"left behind").unwrap();
    assert_eq!((files(&app), app.service.app.store.sweep(true).await.unwrap(), files(&app)), (2, 1, 1));
    let copy = tempfile::tempdir().unwrap();
    app.service.app.store.copy_to(copy.path()).await.unwrap();
    let store = ropescope::store::Store::open(copy.path()).await.unwrap();
    let acquisition = ropescope::store::Id(id.parse().unwrap());
    assert_eq!(store.previews(acquisition).await.unwrap(), []);
    assert_eq!(store.previews_there(acquisition).await.unwrap().job_id, None, "no job waits for what is not there");
}
