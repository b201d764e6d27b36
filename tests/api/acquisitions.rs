//! Acquisitions: announced, completed, deleted.

use crate::app::{TestApp, new_id, png};
use serde_json::{Value, json};

#[tokio::test]
async fn an_acquisition_is_complete_only_when_every_announced_frame_is_there() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let id = app.admin.acquisition(&rope, &[Some(3), None]).await;
    let completion = format!("acquisitions/{id}/completion");
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    app.admin.put_frame(&id, 0, 2, png(2)).await.ok(201);
    app.admin.put_frame(&id, 1, 0, png(9)).await.ok(201);
    let problem = app.admin.post(&completion, json!({})).await.problem(409, "acquisition-incomplete");
    assert_eq!(problem["missing"][0]["missing"], json!([[1, 1]]));
    assert_eq!(problem["missing"][1]["expected"], json!(null));
    let body = json!({ "views": [{ "frames": 3 }, { "frames": 1 }] });
    app.admin.post(&completion, body.clone()).await.problem(409, "acquisition-incomplete");
    app.admin.put_frame(&id, 0, 1, png(1)).await.ok(201);
    let contradiction = json!({ "views": [{ "frames": 4 }, { "frames": 1 }] });
    app.admin.post(&completion, contradiction).await.problem(409, "frames-contradict");
    app.admin.post(&completion, json!({ "views": [{ "frames": 3 }] })).await.problem(422, "out-of-range");
    assert_eq!(app.admin.post(&completion, body).await.ok(200)["state"], "complete");
    assert_eq!(app.admin.post(&completion, json!({})).await.ok(200)["frames_present"], 4);
    let missing = app.admin.get(&format!("acquisitions/{id}/missing")).await.ok(200);
    assert_eq!(missing["complete"], true);
}

#[tokio::test]
async fn how_many_frames_a_view_has_may_become_known_later_but_never_less_than_are_there() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let path = format!("acquisitions/{}", new_id());
    let body = |frames: Value| json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": 64, "views": [{ "angle_deg": 0, "frames": frames }] });
    app.admin.call("PUT", &path, body(Value::Null)).await.ok(201);
    let id = path.rsplit('/').next().unwrap().to_owned();
    for frame in 0..3 {
        app.admin.put_frame(&id, 0, frame, png(frame as u8)).await.ok(201);
    }
    app.admin.call("PUT", &path, body(json!(2))).await.problem(409, "id-in-use");
    assert_eq!(app.admin.get(&path).await.ok(200)["views"][0]["frames"], json!(null), "nothing was changed");
    assert_eq!(app.admin.call("PUT", &path, body(json!(4))).await.ok(200)["views"][0]["frames"], 4);
    app.admin.call("PUT", &path, body(json!(5))).await.problem(409, "id-in-use");
    assert_eq!(app.admin.call("PUT", &path, body(Value::Null)).await.ok(200)["views"][0]["frames"], 4);
    let missing = app.admin.get(&format!("{path}/missing")).await.ok(200);
    assert_eq!(missing["views"][0]["missing"], json!([[3, 3]]));
}

#[tokio::test]
async fn an_acquisition_with_impossible_values_is_refused_with_value_and_limit() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let good = json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": 64, "views": [{ "angle_deg": 0 }] });
    for (field, value, limit) in [
        ("line_pitch_mm", json!(0.0), json!(0.005)),
        ("sensor_px", json!(8), json!(64.0)),
        ("views", json!([]), json!(1.0)),
        ("rope_width_px", json!(4), json!(16.0)),
    ] {
        let mut body = good.clone();
        body[field] = value;
        let problem = app.admin.post("acquisitions", body).await.problem(422, "out-of-range");
        assert_eq!(problem["limit"]["min"], limit, "{problem}");
    }
    let mut body = good.clone();
    body["views"] = json!([{ "angle_deg": 0, "px_per_mm": 90.0 }]);
    let problem = app.admin.post("acquisitions", body).await.problem(422, "out-of-range");
    assert_eq!((&problem["value"], &problem["field"]), (&json!(90.0), &json!("px_per_mm")), "{problem}");
    let mut body = good.clone();
    body["views"] = json!([{ "angle_deg": 0, "px_per_mm": 2.0 }, { "angle_deg": 90 }]);
    let problem = app.admin.post("acquisitions", body).await.problem(422, "out-of-range");
    assert!(problem["detail"].as_str().unwrap().contains("for all of them or for none"), "{problem}");
    let mut body = good.clone();
    body["acquired_at"] = json!("yesterday");
    app.admin.post("acquisitions", body).await.problem(422, "out-of-range");
    let mut body = good;
    body["rope_id"] = json!(new_id());
    app.admin.post("acquisitions", body).await.problem(422, "unknown-reference");
    assert_eq!(app.admin.get("acquisitions").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn the_scale_of_a_view_is_kept_and_part_of_what_an_acquisition_is() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let path = format!("acquisitions/{}", new_id());
    let body = |px_per_mm: Value| json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": 64, "views": [{ "angle_deg": 0, "px_per_mm": px_per_mm }] });
    app.admin.call("PUT", &path, body(json!(1.5))).await.ok(201);
    assert_eq!(app.admin.get(&path).await.ok(200)["views"][0]["px_per_mm"], 1.5);
    app.admin.call("PUT", &path, body(json!(1.5))).await.ok(200);
    app.admin.call("PUT", &path, body(json!(1.6))).await.problem(409, "id-in-use");
}

#[tokio::test]
async fn an_acquisition_can_be_deleted_until_a_job_refers_to_it() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let rope = app.admin.rope().await;
    let id = app.admin.acquisition(&rope, &[Some(1)]).await;
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let delete = |id: &str| app.admin.send(app.admin.request("DELETE", &format!("acquisitions/{id}")));
    assert_eq!(delete(&id).await.status, 204);
    delete(&id).await.problem(404, "not-found");
    assert_eq!(std::fs::read_dir(app.data.path().join("frames")).unwrap().count(), 0);
    let id = app.admin.complete_acquisition(&rope).await;
    app.admin.post("jobs", json!({ "kind": "train", "acquisition_id": id })).await.ok(202);
    delete(&id).await.problem(409, "acquisition-in-use");
    app.admin.get(&format!("acquisitions/{id}/views/0/frames/0")).await;
}
