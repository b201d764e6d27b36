//! Inspections of acquisitions that are still arriving: what they show meanwhile, what they wait for, how they end.

use crate::app::{TestApp, new_id, png};
use ropescope::store::tokens::Role;
use serde_json::{Value, json};
use std::time::Duration;

/// Queues a live inspection and answers its id.
async fn live(app: &TestApp, acquisition: &str, model: Option<&str>) -> String {
    let body = json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model, "live": true });
    let job = app.admin.post("jobs", body).await.ok(202);
    assert_eq!(job["live"], true);
    job["id"].as_str().unwrap().to_owned()
}

/// Looks at something until it is as it shall be.
async fn until(app: &TestApp, path: &str, is: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..400 {
        let value = app.admin.get(path).await.ok(200);
        if is(&value) {
            return value;
        }
        tokio::time::sleep(Duration::from_millis(25)).await;
    }
    panic!("{path} stays {}", app.admin.get(path).await.text());
}

async fn until_waiting_for(app: &TestApp, job: &str, view: u32, frame: u32) -> Value {
    let place = |job: &Value| (job["waiting_for"]["view"].clone(), job["waiting_for"]["frame"].clone());
    until(app, &format!("jobs/{job}"), |job| place(job) == (json!(view), json!(frame))).await
}

/// The events of a job, as they come.
struct Events {
    response: reqwest::Response,
    unread: String,
}

impl Events {
    async fn of(app: &TestApp, job: &str) -> Self {
        let response = app.admin.request("GET", &format!("jobs/{job}/events")).send().await.unwrap();
        Self { response, unread: String::new() }
    }

    /// The data of the next event of a kind; others before it are passed over.
    async fn next(&mut self, kind: &str) -> Value {
        loop {
            while let Some((event, rest)) = self.unread.split_once("\n\n") {
                let data = event.strip_prefix(&format!("event: {kind}\ndata: ")).map(str::to_owned);
                self.unread = rest.to_owned();
                if let Some(data) = data {
                    return serde_json::from_str(&data).unwrap();
                }
            }
            let chunk = self.response.chunk().await.unwrap().unwrap_or_else(|| panic!("no {kind} came"));
            self.unread += std::str::from_utf8(&chunk).unwrap();
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_found_appears_while_frames_arrive_is_marked_provisional_and_goes_when_results_come() {
    let app = TestApp::start().await;
    let (rope, model, inspected) = app.admin.inspected().await;
    let id = app.admin.acquisition(&rope, &[None]).await;
    let job = live(&app, &id, Some(&model)).await;
    let mut events = Events::of(&app, &job).await;
    let (lays, defects) = (format!("jobs/{job}/provisional-lay-lengths"), format!("jobs/{job}/provisional-defects"));
    let rows = |n: usize| move |lays: &Value| lays["rows"].as_array().unwrap().len() == n;
    until_waiting_for(&app, &job, 0, 0).await;

    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let found = until(&app, &lays, rows(1)).await;
    assert_eq!((&found["provisional"], &found["rows"][0]["strand_lay_mm"]), (&json!(true), &json!(137.0)));
    let told = events.next("provisional-lay-lengths").await;
    assert_eq!((&told["provisional"], &told["rows"][0]), (&json!(true), &found["rows"][0]));
    let found = app.admin.get(&defects).await.ok(200);
    assert_eq!((&found["provisional"], &found["defects"][0]["peak_score"]), (&json!(true), &json!(9.0)));
    assert!(found["defects"][0].get("defect_id").is_none(), "nobody can judge what is provisional");
    assert_eq!(events.next("provisional-defects").await, found);

    // A gap is awaited, and told; what lies behind it is not looked at before it is filled.
    app.admin.put_frame(&id, 0, 2, png(2)).await.ok(201);
    let waiting = until_waiting_for(&app, &job, 0, 1).await;
    assert_eq!(waiting["state"], "running");
    assert_eq!(app.admin.get(&lays).await.ok(200)["rows"].as_array().unwrap().len(), 1);
    app.admin.put_frame(&id, 0, 1, png(1)).await.ok(201);
    until(&app, &lays, rows(3)).await;
    assert_eq!(events.next("provisional-lay-lengths").await["rows"][0]["first_line"], 100, "only what is new");
    assert_eq!(app.admin.get(&format!("{lays}?after_line=99")).await.ok(200)["rows"][0]["first_line"], 100);
    assert_eq!(app.admin.get(&format!("{lays}?view=0")).await.ok(200)["rows"], json!([]));
    app.admin.get(&format!("{lays}?view=4")).await.problem(404, "view-out-of-range");

    // Nothing of it can be taken for a result.
    let mine = |list: &Value| list["items"].as_array().unwrap().len();
    assert_eq!(mine(&app.admin.get(&format!("inspections?acquisition_id={id}")).await.ok(200)), 0);
    assert_eq!(mine(&app.admin.get("defects").await.ok(200)), 1, "only that of inspection {inspected}");

    app.admin.post(&format!("acquisitions/{id}/completion"), json!({ "views": [{ "frames": 3 }] })).await.ok(200);
    let ended = app.admin.ended(&job).await;
    assert_eq!((&ended["state"], &ended["waiting_for"]), (&json!("succeeded"), &Value::Null), "{ended}");
    let inspection = ended["result"]["inspection_id"].as_str().unwrap();
    for path in [&lays, &defects] {
        let gone = app.admin.get(path).await.problem(410, "provisional-gone");
        assert!(gone["detail"].as_str().unwrap().contains(inspection), "{gone}");
    }
    app.admin.get(&format!("{lays}?view=")).await.problem(400, "malformed-query");
    let lay_lengths = app.admin.get(&format!("inspections/{inspection}/lay-lengths")).await.ok(200);
    assert_eq!(lay_lengths["rows"].as_array().unwrap().len(), 3);
    assert_eq!(events.next("end").await["result"]["inspection_id"], inspection);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_waits_for_frames_keeps_no_other_job_from_running() {
    let app = TestApp::start_with(|s| (s.workers, s.live.jobs) = (1, 1)).await;
    let rope = app.admin.rope().await;
    let open = app.admin.acquisition(&rope, &[Some(3)]).await;
    let waiting = live(&app, &open, None).await;
    until_waiting_for(&app, &waiting, 0, 0).await;
    let complete = app.admin.complete_acquisition(&rope).await;
    let done = app.admin.run(json!({ "kind": "inspect", "acquisition_id": complete })).await;
    assert_eq!(done["state"], "succeeded");
    // A second live one has no place until the first ends, or its own acquisition is complete: then it is a job like others.
    let second = app.admin.acquisition(&rope, &[Some(1)]).await;
    let queued = live(&app, &second, None).await;
    app.admin.put_frame(&second, 0, 0, png(7)).await.ok(201);
    assert_eq!(app.admin.get(&format!("jobs/{queued}")).await.ok(200)["state"], "queued");
    app.admin.post(&format!("acquisitions/{second}/completion"), json!({})).await.ok(200);
    assert_eq!(app.admin.ended(&queued).await["state"], "succeeded");
    assert_eq!(app.admin.get(&format!("jobs/{waiting}")).await.ok(200)["state"], "running");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_waiting_job_is_cancelled_like_any_other_and_leaves_nothing_provisional() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(3)]).await;
    let job = live(&app, &id, None).await;
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    until_waiting_for(&app, &job, 0, 1).await;
    app.admin.send(app.admin.request("POST", &format!("jobs/{job}/cancellation"))).await.ok(202);
    let ended = app.admin.ended(&job).await;
    assert_eq!((&ended["state"], &ended["result"]), (&json!("cancelled"), &Value::Null));
    app.admin.get(&format!("jobs/{job}/provisional-lay-lengths")).await.problem(410, "provisional-gone");
    let left = app.service.app.store.provisional_lay_lengths(ropescope::store::Id(job.parse().unwrap()), None, None, 9);
    assert_eq!(left.await.unwrap(), []);
    assert_eq!(app.admin.get("inspections").await.ok(200)["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_acquisition_that_nobody_continues_ends_its_job_with_a_reason_and_a_way_out() {
    let app = TestApp::start_with(|s| s.live.patience = Duration::from_millis(300)).await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(3)]).await;
    let job = live(&app, &id, None).await;
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let ended = app.admin.ended(&job).await;
    assert_eq!(
        (&ended["state"], &ended["error"]["type"]),
        (&json!("failed"), &json!("/problems/acquisition-abandoned"))
    );
    let detail = ended["error"]["detail"].as_str().unwrap();
    assert!(detail.contains("frame 1 of view 0 did not come"), "{detail}");
    assert!(detail.contains("queue the job again"), "{detail}");
    // The acquisition is as it was.
    for frame in 1..3 {
        app.admin.put_frame(&id, 0, frame, png(frame as u8)).await.ok(201);
    }
    app.admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
    assert_eq!(app.admin.ended(&live(&app, &id, None).await).await["state"], "succeeded");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_waiting_job_is_handed_back_when_the_service_goes_down_and_begins_anew_in_the_next() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(2)]).await;
    let job = live(&app, &id, None).await;
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    until_waiting_for(&app, &job, 0, 1).await;
    let TestApp { service, data, .. } = app;
    service.stop().await;
    let app = TestApp::start_on(data, |_| {}).await;
    until_waiting_for(&app, &job, 0, 1).await;
    let found = app.admin.get(&format!("jobs/{job}/provisional-lay-lengths")).await.ok(200);
    assert_eq!((found["rows"].as_array().unwrap().len(), &found["run"]), (1, &json!(2)), "{found}");
    app.admin.put_frame(&id, 0, 1, png(1)).await.ok(201);
    app.admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
    assert_eq!(app.admin.ended(&job).await["state"], "succeeded");
}

#[tokio::test]
async fn whether_a_job_is_live_belongs_to_what_was_asked_for_and_its_findings_are_for_readers_only() {
    let app = TestApp::start_with(|s| s.workers = 0).await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(2)]).await;
    let mut body = json!({ "kind": "inspect", "acquisition_id": id, "live": true, "idempotency_key": "k" });
    let job = app.admin.post("jobs", body.clone()).await.ok(202)["id"].as_str().unwrap().to_owned();
    body["live"] = json!(false);
    app.admin.post("jobs", body).await.problem(409, "idempotency-key-reused");
    let train = json!({ "kind": "train", "acquisition_id": id, "live": true });
    app.admin.post("jobs", train).await.problem(400, "malformed-body");
    let uploader = app.caller(Role::Upload).await;
    for what in ["provisional-lay-lengths", "provisional-defects"] {
        uploader.get(&format!("jobs/{job}/{what}")).await.problem(403, "forbidden");
        app.admin.get(&format!("jobs/{}/{what}", new_id())).await.problem(404, "not-found");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_frame_is_awaited_until_it_was_sent_again_and_never_taken_for_the_end_of_its_view() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(3)]).await;
    for frame in 0..3 {
        app.admin.put_frame(&id, 0, frame, png(frame as u8)).await.ok(201);
    }
    let (store, acquisition) = (&app.service.app.store, ropescope::store::Id(id.parse().unwrap()));
    let damaged = store.frame(acquisition, 0, 1).await.unwrap().unwrap();
    store.mark_damaged(std::slice::from_ref(&damaged), 1).await.unwrap();
    let job = live(&app, &id, None).await;
    until_waiting_for(&app, &job, 0, 1).await;
    app.admin.put_frame(&id, 0, 1, png(1)).await.ok(201);
    until_waiting_for(&app, &job, 0, 3).await;
    app.admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
    assert_eq!(app.admin.ended(&job).await["state"], "succeeded");

    // Found damaged after the completion, it belongs to the rope all the same: a job fails on it, and does not end before it.
    store.mark_damaged(&[damaged], 2).await.unwrap();
    assert_eq!(store.frames_from(acquisition, 0, 0, 10, true).await.unwrap().len(), 3);
    assert_eq!(store.frames_from(acquisition, 0, 0, 10, false).await.unwrap().len(), 1);
}
