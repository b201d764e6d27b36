//! Trainings on several acquisitions of one rope.

use crate::app::{Caller, LINES, SENSOR_PX, TestApp, new_id, png, png_of, rope};
use ropescope::store::tokens::Role;
use serde_json::{Value, json};

fn train(acquisition: &str, further: Value) -> Value {
    json!({ "kind": "train", "acquisition_id": acquisition, "to_m": 5.02, "further_acquisitions": further })
}

/// A rope with two complete acquisitions.
async fn two_days(admin: &Caller) -> (String, String, String) {
    let rope = admin.rope().await;
    let (may, august) = (admin.complete_acquisition(&rope).await, admin.complete_acquisition(&rope).await);
    (rope, may, august)
}

/// A complete acquisition that was taken otherwise than those of `Caller`.
async fn taken_otherwise(admin: &Caller, rope: &str, sensor_px: u32, change: Value) -> String {
    let mut body = json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": sensor_px, "views": [{ "angle_deg": 0.0, "frames": 1 }] });
    body.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
    let views = body["views"].as_array().unwrap().len();
    let id = admin.post("acquisitions", body).await.ok(201)["id"].as_str().unwrap().to_owned();
    for view in 0..views {
        admin.put_frame(&id, view as u32, 0, png_of(sensor_px, LINES, 1)).await.ok(201);
    }
    admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
    id
}

#[tokio::test]
async fn several_acquisitions_teach_one_model_which_says_what_each_gave() {
    let app = TestApp::start().await;
    let (_, may, august) = two_days(&app.admin).await;
    let further =
        json!([{ "acquisition_id": august, "from_m": 5.01 }, { "acquisition_id": may, "from_m": 5.02, "to_m": null }]);
    let job = app.admin.run(train(&may, further)).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    let listed = json!([{ "acquisition_id": august, "from_m": 5.01, "to_m": null }, { "acquisition_id": may, "from_m": 5.02, "to_m": null }]);
    assert_eq!((&job["acquisition_id"], &job["further_acquisitions"]), (&json!(may), &listed));
    let model = format!("models/{}", job["result"]["model_id"].as_str().unwrap());
    let trained_on = app.admin.get(&model).await.ok(200)["trained_on"].clone();
    assert_eq!(trained_on["acquisition_id"], json!(may));
    let gave: Vec<_> =
        trained_on["acquisitions"].as_array().unwrap().iter().map(|a| (&a["acquisition_id"], &a["from_m"])).collect();
    assert_eq!(gave, [(&json!(may), &json!(0.0)), (&json!(august), &json!(5.01)), (&json!(may), &json!(5.02))]);
    // Whoever looks for what needs an acquisition finds the job once.
    for acquisition in [&may, &august] {
        let jobs = app.admin.get(&format!("jobs?acquisition_id={acquisition}")).await.ok(200)["items"].clone();
        assert_eq!((jobs.as_array().unwrap().len(), &jobs[0]["id"]), (1, &job["id"]));
    }
    // The present form is a list of one.
    let job = app.admin.run(json!({ "kind": "train", "acquisition_id": may })).await;
    assert_eq!(job["further_acquisitions"], json!([]));
    let model = format!("models/{}", job["result"]["model_id"].as_str().unwrap());
    let trained_on = app.admin.get(&model).await.ok(200)["trained_on"].clone();
    let alone = json!([{ "acquisition_id": may, "from_m": 0.0, "to_m": 1.0, "learnt_view_m": 1.0 }]);
    assert_eq!(trained_on["acquisitions"], alone);
}

#[tokio::test]
async fn acquisitions_that_cannot_teach_one_model_are_refused_and_nothing_is_queued() {
    let app = TestApp::start().await;
    let admin = &app.admin;
    let (rope_id, may, august) = two_days(admin).await;
    let with = |other: &str| train(&may, json!([{ "acquisition_id": august }, { "acquisition_id": other }]));
    let field = "further_acquisitions[1]";

    let unknown = new_id();
    let problem = admin.post("jobs", with(&unknown)).await.problem(422, "unknown-reference");
    assert_eq!((&problem["value"], &problem["field"]), (&json!(unknown), &json!(format!("{field}.acquisition_id"))));

    let open = admin.acquisition(&rope_id, &[Some(2)]).await;
    admin.put_frame(&open, 0, 0, png(0)).await.ok(201);
    let problem = admin.post("jobs", with(&open)).await.problem(409, "acquisition-incomplete");
    assert!(
        problem["detail"].as_str().unwrap().starts_with(&format!("1 of 2 frames of acquisition {open}")),
        "{problem}"
    );

    let ropeway = admin.ropeway().await;
    let other_rope = admin.post("ropes", rope(&ropeway)).await.ok(201)["id"].as_str().unwrap().to_owned();
    let of_other_rope = admin.complete_acquisition(&other_rope).await;
    let problem = admin.post("jobs", with(&of_other_rope)).await.problem(422, "acquisition-of-another-rope");
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(other_rope), &json!(rope_id)));

    let two_views = json!({ "views": [{ "angle_deg": 0.0, "frames": 1 }, { "angle_deg": 90.0, "frames": 1 }] });
    for (sensor_px, change, value, limit) in [
        (96, json!({}), "96 px", "64 px"),
        (SENSOR_PX, json!({ "line_pitch_mm": 0.2 }), "0.2 mm", "0.1 mm"),
        (SENSOR_PX, json!({ "views": [{ "angle_deg": 90.0, "frames": 1 }] }), "90.0 degrees", "0.0 degrees"),
        (SENSOR_PX, two_views, "2", "1"),
    ] {
        let other = taken_otherwise(admin, &rope_id, sensor_px, change).await;
        let problem = admin.post("jobs", with(&other)).await.problem(422, "acquisitions-differ");
        assert_eq!(
            (&problem["value"], &problem["limit"], &problem["field"]),
            (&json!(value), &json!(limit), &json!(field))
        );
        assert!(problem["detail"].as_str().unwrap().contains(&other), "{problem}");
    }

    let twice = train(&may, json!([{ "acquisition_id": may, "from_m": 5.01 }]));
    let problem = admin.post("jobs", twice).await.problem(422, "ranges-overlap");
    assert_eq!((&problem["value"], &problem["field"]), (&json!(may), &json!("further_acquisitions[0]")));
    let backwards = train(&may, json!([{ "acquisition_id": august, "from_m": 3.0, "to_m": 1.0 }]));
    let problem = admin.post("jobs", backwards).await.problem(422, "out-of-range");
    assert_eq!(problem["field"], "further_acquisitions[0]");
    let many: Vec<_> = (0..16).map(|_| json!({ "acquisition_id": new_id() })).collect();
    let problem = admin.post("jobs", train(&may, json!(many))).await.problem(422, "out-of-range");
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(16), &json!(15)));
    let inspect = json!({ "kind": "inspect", "acquisition_id": may, "further_acquisitions": [] });
    admin.post("jobs", inspect).await.problem(400, "malformed-body");
    for role in [Role::Upload, Role::Read, Role::Ticketing] {
        app.caller(role).await.post("jobs", with(&august)).await.problem(403, "forbidden");
    }
    let nobody = Caller { token: None, ..admin.clone() };
    nobody.post("jobs", with(&august)).await.problem(401, "unauthorized");
    assert_eq!(admin.get("jobs").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn the_same_key_with_other_further_acquisitions_is_another_request() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let (_, may, august) = two_days(&app.admin).await;
    let request = |further: Value| {
        let mut body = train(&may, further);
        body["idempotency_key"] = json!("k1");
        body
    };
    let both = request(json!([{ "acquisition_id": august, "to_m": 5.01 }]));
    let job = app.admin.post("jobs", both.clone()).await.ok(202);
    assert_eq!(app.admin.post("jobs", both).await.ok(202), job);
    for other in [json!([]), json!([{ "acquisition_id": august }])] {
        app.admin.post("jobs", request(other)).await.problem(409, "idempotency-key-reused");
    }
}

#[tokio::test]
async fn what_a_training_needs_is_neither_deleted_nor_removed_by_retention() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let (rope, may, august) = two_days(&app.admin).await;
    let job = app.admin.post("jobs", train(&may, json!([{ "acquisition_id": august }]))).await.ok(202);
    let august_path = format!("acquisitions/{august}");
    let delete = || app.admin.send(app.admin.request("DELETE", &august_path));
    assert_eq!(delete().await.problem(409, "acquisition-in-use")["value"], json!(1));

    let ropeway = app.admin.get(&format!("ropes/{rope}")).await.ok(200)["ropeway_id"].as_str().unwrap().to_owned();
    app.admin.call("PUT", &format!("ropeways/{ropeway}/storage"), json!({ "keep_days": 1 })).await.ok(200);
    let store = &app.service.app.store;
    let later = app.service.app.now_ms() + 10 * 86_400_000;
    let kept = || async {
        let overdue = store.overdue(later).await.unwrap();
        overdue.into_iter().find(|o| o.id.to_string() == august).unwrap()
    };
    let overdue = kept().await;
    assert_eq!(overdue.kept_because.as_deref(), Some("a job works on it"));
    assert!(!store.remove_frames(overdue.id, later).await.unwrap());
    let cancel = app.admin.request("POST", &format!("jobs/{}/cancellation", job["id"].as_str().unwrap()));
    app.admin.send(cancel).await.ok(202);
    let why = Some("it was never inspected with a model");
    assert_eq!(kept().await.kept_because.as_deref(), why, "the job needs it no more");
}
