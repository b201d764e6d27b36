//! Jobs: asked for, watched, cancelled, handed back.

use crate::app::{TestApp, new_id, png, rope};
use serde_json::{Value, json};
use std::sync::atomic::Ordering;

#[tokio::test]
async fn a_job_on_an_incomplete_acquisition_is_refused_with_what_is_missing() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let id = app.admin.acquisition(&rope, &[Some(2)]).await;
    app.admin.put_frame(&id, 0, 1, png(0)).await.ok(201);
    let body = json!({ "kind": "inspect", "acquisition_id": id });
    let problem = app.admin.post("jobs", body).await.problem(409, "acquisition-incomplete");
    assert_eq!(problem["missing"][0]["missing"], json!([[0, 0]]));
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(1), &json!(2)));
    assert_eq!(app.admin.get("jobs").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn jobs_that_refer_to_nothing_or_to_another_rope_are_refused() {
    let app = TestApp::start().await;
    let (rope_id, model, _) = app.admin.inspected().await;
    let inspect =
        |acquisition: &str, model: &str| json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model });
    let acquisition = app.admin.complete_acquisition(&rope_id).await;
    app.admin.post("jobs", inspect(&new_id(), &model)).await.problem(422, "unknown-reference");
    app.admin.post("jobs", inspect(&acquisition, &new_id())).await.problem(422, "unknown-reference");
    let ropeway = app.admin.ropeway().await;
    let other = app.admin.post("ropes", rope(&ropeway)).await.ok(201)["id"].as_str().unwrap().to_owned();
    let other = app.admin.complete_acquisition(&other).await;
    let problem = app.admin.post("jobs", inspect(&other, &model)).await.problem(422, "model-of-another-rope");
    assert_eq!(problem["value"], rope_id);
    let train = json!({ "kind": "train", "acquisition_id": acquisition, "from_m": 3.0, "to_m": 1.0 });
    app.admin.post("jobs", train).await.problem(422, "out-of-range");
    app.admin
        .post("jobs", json!({ "kind": "paint", "acquisition_id": acquisition }))
        .await
        .problem(400, "malformed-body");
}

#[tokio::test]
async fn the_same_key_is_the_same_job() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let acquisition = app.admin.complete_acquisition(&app.admin.rope().await).await;
    let body = json!({ "kind": "train", "acquisition_id": acquisition, "idempotency_key": "k1" });
    let first = app.admin.post("jobs", body.clone()).await;
    let job = first.ok(202);
    assert_eq!(first.header("location"), format!("/api/v1/jobs/{}", job["id"].as_str().unwrap()));
    assert_eq!(app.admin.post("jobs", body.clone()).await.ok(202), job);
    let mut other = body;
    other["to_m"] = json!(1.0);
    app.admin.post("jobs", other).await.problem(409, "idempotency-key-reused");
    assert_eq!(app.admin.get("jobs?state=queued").await.ok(200)["items"].as_array().unwrap().len(), 1);
    assert_eq!(app.admin.get("jobs?state=failed").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn a_queued_job_is_cancelled_at_once_and_a_running_one_soon() {
    let app = TestApp::start().await;
    app.engine.hold.store(true, Ordering::SeqCst);
    let acquisition = app.admin.complete_acquisition(&app.admin.rope().await).await;
    let body = json!({ "kind": "train", "acquisition_id": acquisition });
    let id = |job: &Value| job["id"].as_str().unwrap().to_owned();
    let running = id(&app.admin.post("jobs", body.clone()).await.ok(202));
    app.admin.reached(&running, "running").await;
    let queued = id(&app.admin.post("jobs", body).await.ok(202));
    let cancel = |id: &str| app.admin.send(app.admin.request("POST", &format!("jobs/{id}/cancellation")));
    assert_eq!(cancel(&queued).await.ok(202)["state"], "cancelled");
    assert_eq!(cancel(&queued).await.ok(202)["state"], "cancelled");
    cancel(&running).await.ok(202);
    assert_eq!(app.admin.ended(&running).await["state"], "cancelled");
    app.engine.hold.store(false, Ordering::SeqCst);
    assert_eq!(std::fs::read_dir(app.data.path().join("work")).unwrap().count(), 0);
    assert_eq!(app.admin.get("models").await.ok(200)["items"], json!([]));
    let done = app.admin.run(json!({ "kind": "train", "acquisition_id": acquisition })).await;
    assert_eq!(done["state"], "succeeded");
    cancel(done["id"].as_str().unwrap()).await.problem(409, "job-ended");
    cancel(&new_id()).await.problem(404, "not-found");
}

#[tokio::test]
async fn progress_comes_as_events_and_ends() {
    let app = TestApp::start().await;
    app.engine.hold.store(true, Ordering::SeqCst);
    let acquisition = app.admin.complete_acquisition(&app.admin.rope().await).await;
    let job = app.admin.post("jobs", json!({ "kind": "train", "acquisition_id": acquisition })).await.ok(202);
    let path = format!("jobs/{}/events", job["id"].as_str().unwrap());
    let admin = app.admin.clone();
    let events = tokio::spawn(async move { admin.get(&path).await });
    for _ in 0..200 {
        let job = app.admin.get(&format!("jobs/{}", job["id"].as_str().unwrap())).await.ok(200);
        if job["progress"]["stage"] == "align" {
            assert_eq!(job["progress"]["fraction"], 0.5);
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    app.engine.hold.store(false, Ordering::SeqCst);
    let events = events.await.unwrap();
    assert!(events.header("content-type").starts_with("text/event-stream"));
    let text = events.text();
    assert!(text.matches("event: progress").count() >= 2, "{text}");
    assert!(text.trim_end().rsplit("\n\n").next().unwrap().starts_with("event: end"), "{text}");
    app.admin.get(&format!("jobs/{}/events", new_id())).await.problem(404, "not-found");
}

#[tokio::test]
async fn a_job_is_handed_back_when_the_service_goes_down_and_runs_again_in_the_next() {
    let app = TestApp::start().await;
    app.engine.hold.store(true, Ordering::SeqCst);
    let acquisition = app.admin.complete_acquisition(&app.admin.rope().await).await;
    let job = app.admin.post("jobs", json!({ "kind": "train", "acquisition_id": acquisition })).await.ok(202);
    let id = job["id"].as_str().unwrap().to_owned();
    app.admin.reached(&id, "running").await;
    let TestApp { service, data, .. } = app;
    service.stop().await;
    let app = TestApp::start_on(data, |_| {}).await;
    let job = app.admin.ended(&id).await;
    assert_eq!((&job["state"], &job["attempts"]), (&json!("succeeded"), &json!(1)), "{job}");
    assert_eq!(app.admin.get("models").await.ok(200)["items"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn two_services_on_one_data_folder_are_refused() {
    let app = TestApp::start().await;
    let second = ropescope::service::Service::start(crate::app::settings(app.data.path())).await;
    let error = second.err().expect("refused").to_string();
    assert!(error.contains("in use by another"), "{error}");
}
