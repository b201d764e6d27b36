//! Another threshold for an inspection that has ended: places move between the levels, and nothing else changes.

use crate::app::{Caller, TestApp, new_id, png};
use crate::toy_engine::{TRAINED_LOOK_AGAIN, TRAINED_THRESHOLD};
use ropescope::store::tokens::Role;
use serde_json::{Value, json};

/// The toy finds a defect with this peak ...
const DEFECT: f64 = 9.0;
/// ... and a place to look at again with this one.
const LOOK_AGAIN: f64 = 5.0;

/// Peak scores and ranks over a level, along the rope.
async fn found(admin: &Caller, inspection: &str, level: &str) -> Vec<(f64, u64)> {
    let list = admin.get(&format!("inspections/{inspection}/defects?level={level}")).await.ok(200);
    let place = |d: &Value| (d["peak_score"].as_f64().unwrap(), d["rank"].as_u64().unwrap_or(0));
    list["items"].as_array().unwrap().iter().map(place).collect()
}

/// The id of the place with a peak score.
async fn place(admin: &Caller, inspection: &str, peak_score: f64) -> String {
    let list = admin.get(&format!("inspections/{inspection}/defects?level=any")).await.ok(200);
    let place = list["items"].as_array().unwrap().iter().find(|d| d["peak_score"] == json!(peak_score));
    place.unwrap_or_else(|| panic!("{list}"))["defect_id"].as_str().unwrap().to_owned()
}

async fn summary(admin: &Caller, inspection: &str) -> Value {
    admin.get(&format!("inspections/{inspection}")).await.ok(200)["summary"].clone()
}

fn wish(line_score: f64) -> Value {
    json!({ "line_score": line_score, "reason": "season of rain", "by": "A. Inspector" })
}

#[tokio::test]
async fn places_move_between_the_levels_without_a_job_and_everything_follows() {
    let app = TestApp::start().await;
    let (_, model, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/thresholds");
    let defect = place(&app.admin, &inspection, DEFECT).await;
    let jobs = app.admin.get("jobs").await.ok(200);
    let surface_alarms = async || {
        app.admin.get(&format!("inspections/{inspection}/surface-alarms")).await.ok(200)["surface_alarms"].clone()
    };
    let before = async || {
        let tried = format!("models/{model}/threshold-preview");
        let preview = app.admin.post(&tried, json!({ "line_score": 7 })).await.ok(200)["inspections"][0].clone();
        (preview["threshold"]["line_score"].as_f64().unwrap(), preview["before"]["defects"].clone())
    };
    let of_job = app.admin.get(&path).await.ok(200)["items"].clone();
    assert_eq!((&of_job[0]["number"], &of_job[0]["line_score"]), (&json!(0), &json!(TRAINED_THRESHOLD)));

    let higher = app.admin.post(&path, wish(9.5)).await.ok(201);
    assert_eq!((&higher["closed"], &higher["opened"], &higher["kept"]), (&json!([defect]), &json!([]), &json!([])));
    assert_eq!(found(&app.admin, &inspection, "alarm").await, []);
    assert_eq!(found(&app.admin, &inspection, "look_again").await, [(DEFECT, 1), (LOOK_AGAIN, 2)], "ranked anew");
    assert_eq!((surface_alarms().await, before().await), (json!(0), (9.5, json!(0))));
    let told = summary(&app.admin, &inspection).await;
    assert_eq!((&told["defects"], &told["look_again"]), (&json!(0), &json!(2)));
    assert_eq!(told["threshold"]["origin"], "applied afterwards by A. Inspector: season of rain");
    assert_eq!(told["threshold"]["look_again_line_score"], json!(TRAINED_LOOK_AGAIN), "nothing is stored below");
    assert_eq!(app.admin.get("inspections").await.ok(200)["items"][0]["summary"], told);

    let again = app.admin.post(&path, wish(9.5)).await.ok(200);
    assert_eq!((&again["threshold"], &again["closed"]), (&higher["threshold"], &json!([])));

    let lower = app.admin.post(&path, json!({ "line_score": 4.9, "reason": "a closer look" })).await.ok(201);
    assert_eq!(lower["opened"].as_array().unwrap().len(), 2);
    assert_eq!(lower["opened"][0], json!(defect), "it is the same defect");
    assert_eq!(found(&app.admin, &inspection, "alarm").await, [(DEFECT, 1), (LOOK_AGAIN, 2)]);
    assert_eq!((surface_alarms().await, before().await), (json!(2), (4.9, json!(2))));

    let history = app.admin.get(&path).await.ok(200)["items"].clone();
    assert_eq!(history, json!([lower["threshold"], higher["threshold"], of_job[0]]));
    assert_eq!((&history[0]["by"], &history[0]["defects"]), (&json!("test"), &json!(2)), "else the name of the token");
    assert_eq!((&history[1]["by"], &history[1]["reason"]), (&json!("A. Inspector"), &json!("season of rain")));
    assert_eq!(app.admin.get("jobs").await.ok(200), jobs, "nothing was computed anew");
}

#[tokio::test]
async fn under_the_look_again_level_nothing_is_stored_so_it_is_refused_with_that_level_and_the_way_out() {
    let app = TestApp::start().await;
    let (rope, _, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/thresholds");
    let problem = app.admin.post(&path, wish(4.7)).await.problem(422, "below-look-again");
    assert_eq!(problem["limit"]["min"], json!(TRAINED_LOOK_AGAIN));
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("look-again level of this inspection, 4.8") && detail.contains("a job"), "{detail}");
    app.admin.post(&path, wish(TRAINED_LOOK_AGAIN)).await.ok(201); // all that is stored

    // A job with a threshold of its own and no second level stored its defects only.
    let acquisition = app.admin.complete_acquisition(&rope).await;
    let model = app.admin.get("models").await.ok(200)["items"][0]["id"].clone();
    let own = json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model, "threshold": 4.0 });
    let one_level = app.admin.run(own).await["result"]["inspection_id"].as_str().unwrap().to_owned();
    let path_of_one = format!("inspections/{one_level}/thresholds");
    let problem = app.admin.post(&path_of_one, wish(3.9)).await.problem(422, "below-look-again");
    assert_eq!(problem["limit"]["min"], json!(4.0));
    app.admin.post(&path_of_one, wish(9.5)).await.ok(201);
    let told = summary(&app.admin, &one_level).await;
    assert_eq!(told["threshold"]["look_again_line_score"], json!(4.0), "what lies between is worth looking at again");
    assert_eq!(told["look_again"], json!(2));

    for (body, status, slug) in [
        (json!({}), 400, "malformed-body"),
        (json!({ "line_score": 6 }), 400, "malformed-body"),
        (json!({ "line_score": 6, "reason": "" }), 422, "out-of-range"),
        (json!({ "line_score": 1001, "reason": "x" }), 422, "out-of-range"),
        (json!({ "version": 7 }), 422, "unknown-reference"),
        (json!({ "version": 0, "reason": "x" }), 400, "malformed-body"),
    ] {
        app.admin.post(&path, body).await.problem(status, slug);
    }
    assert_eq!(app.admin.get(&path).await.ok(200)["items"].as_array().unwrap().len(), 2, "refusals change nothing");
}

#[tokio::test]
async fn what_was_decided_on_or_has_a_ticket_is_never_hidden_and_no_defect_gets_two_tickets() {
    let app = TestApp::start().await;
    let (rope, _, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/thresholds");
    let endpoint = json!({ "url": "http://127.0.0.1:9/hook" }); // a private address: nothing is sent
    app.admin.post("webhook-endpoints", endpoint).await.ok(201);
    let level = json!({ "ticket_level": 4.5 });
    app.admin.call("PATCH", &format!("ropes/{rope}/ticketing"), level).await.ok(200);
    let ticketed = async || {
        let list = app.admin.get("deliveries").await.ok(200);
        list["items"].as_array().unwrap().iter().map(|d| d["defect_id"].clone()).collect::<Vec<_>>()
    };
    let (defect, again) =
        (place(&app.admin, &inspection, DEFECT).await, place(&app.admin, &inspection, LOOK_AGAIN).await);
    let verdict = json!({ "verdict": "confirmed", "by": "B. Inspector" });
    app.admin.post(&format!("defects/{defect}/verdict"), verdict).await.ok(200);
    assert_eq!(ticketed().await, [json!(defect)]);

    let lower = app.admin.post(&path, wish(4.9)).await.ok(201);
    assert_eq!((&lower["opened"], &lower["tickets"]), (&json!([again]), &json!(1)));
    assert_eq!(ticketed().await, [json!(again), json!(defect)], "as if the job had found it");
    assert_eq!(app.admin.post(&path, wish(4.9)).await.ok(200)["tickets"], json!(0));

    let higher = app.admin.post(&path, wish(9.5)).await.ok(201);
    assert_eq!(higher["closed"], json!([]));
    assert_eq!(
        higher["kept"],
        json!([
            { "defect_id": defect, "peak_score": DEFECT, "why": "B. Inspector has confirmed it" },
            { "defect_id": again, "peak_score": LOOK_AGAIN, "why": "its ticket was sent or is on its way" }
        ])
    );
    assert_eq!(found(&app.admin, &inspection, "alarm").await.len(), 2);
    assert_eq!(app.admin.get(&format!("defects/{defect}")).await.ok(200)["verdict"]["by"], "B. Inspector");
    let written = json!({ "number": "4711", "state": "open" });
    app.admin.call("PUT", &format!("defects/{again}/ticket"), written).await.ok(200);
    let still = app.admin.post(&path, wish(9.5)).await.ok(200);
    assert_eq!(still["kept"][1]["why"], "it has the ticket 4711");

    app.admin.post(&path, wish(4.8)).await.ok(201);
    assert_eq!(ticketed().await.len(), 2, "no event twice");
}

#[tokio::test]
async fn a_dismissed_place_becomes_a_dismissed_defect_without_a_ticket_and_all_of_it_outlives_a_restart() {
    let app = TestApp::start().await;
    let (rope, _, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/thresholds");
    app.admin.call("PATCH", &format!("ropes/{rope}/ticketing"), json!({ "ticket_level": 1 })).await.ok(200);
    app.admin.post("webhook-endpoints", json!({ "url": "http://127.0.0.1:9/hook" })).await.ok(201);
    let again = place(&app.admin, &inspection, LOOK_AGAIN).await;
    app.admin.post(&format!("defects/{again}/verdict"), json!({ "verdict": "dismissed" })).await.ok(200);
    let lower = app.admin.post(&path, wish(4.9)).await.ok(201);
    assert_eq!((&lower["opened"], &lower["tickets"]), (&json!([again]), &json!(0)));
    let higher = app.admin.post(&path, wish(7.0)).await.ok(201);
    assert_eq!(higher["kept"][0]["why"], "test has dismissed it");
    let (told, history) = (summary(&app.admin, &inspection).await, app.admin.get(&path).await.ok(200));
    let TestApp { service, data, .. } = app;
    service.stop().await;
    let app = TestApp::start_on(data, |_| {}).await;
    assert_eq!(summary(&app.admin, &inspection).await, told);
    assert_eq!(app.admin.get(&path).await.ok(200), history);
    assert_eq!(app.admin.get("deliveries").await.ok(200)["items"], json!([]));
    let surface = app.admin.get(&format!("inspections/{inspection}/surface-alarms")).await.ok(200);
    assert_eq!(surface["surface_alarms"], json!(1), "what was dismissed is none");
    let repeated = app.admin.post(&path, wish(7.0)).await.ok(200);
    assert_eq!(repeated["threshold"], higher["threshold"], "who repeats it after a restart changes nothing");
}

#[tokio::test]
async fn a_threshold_of_the_model_is_applied_by_its_number() {
    let app = TestApp::start().await;
    let (_, model, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/thresholds");
    let set = json!({ "line_score": 9.2, "by": "A. Inspector", "reason": "old rope" });
    app.admin.call("PUT", &format!("models/{model}/thresholds/1"), set).await.ok(201);
    assert_eq!(summary(&app.admin, &inspection).await["defects"], json!(1), "it holds for later inspections only");
    let applied = app.admin.post(&path, json!({ "version": 1, "by": "B. Inspector" })).await.ok(201);
    let threshold = &applied["threshold"];
    assert_eq!((&threshold["line_score"], &threshold["model_version"]), (&json!(9.2), &json!(1)));
    let origin = "applied afterwards by B. Inspector: version 1 for this model, set by A. Inspector: old rope";
    assert_eq!(threshold["origin"], origin);
    let trained = app.admin.post(&path, json!({ "version": 0 })).await.ok(201);
    assert_eq!(trained["threshold"]["line_score"], json!(TRAINED_THRESHOLD));
    assert_eq!(found(&app.admin, &inspection, "alarm").await, [(DEFECT, 1)]);
}

#[tokio::test]
async fn only_who_may_change_thresholds_may_and_only_of_inspections_that_have_ended_and_judged() {
    let app = TestApp::start().await;
    let (rope, model, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/thresholds");
    for role in [Role::Read, Role::Upload, Role::Ticketing] {
        app.caller(role).await.post(&path, wish(9.5)).await.problem(403, "forbidden");
    }
    assert_eq!(found(&app.admin, &inspection, "alarm").await.len(), 1);
    app.caller(Role::Read).await.get(&path).await.ok(200);
    app.caller(Role::Operator).await.post(&path, wish(9.5)).await.ok(201);

    let open = app.admin.acquisition(&rope, &[None]).await;
    app.admin.put_frame(&open, 0, 0, png(0)).await.ok(201);
    let live = json!({ "kind": "inspect", "acquisition_id": open, "model_id": model, "live": true });
    let job = app.admin.post("jobs", live).await.ok(202)["id"].as_str().unwrap().to_owned();
    app.admin.reached(&job, "running").await;
    let problem =
        app.admin.post(&format!("inspections/{job}/thresholds"), wish(9.5)).await.problem(409, "inspection-running");
    assert!(problem["detail"].as_str().unwrap().contains("wait for its end"), "{problem}");

    let acquisition = app.admin.complete_acquisition(&rope).await;
    let aligned = app.admin.run(json!({ "kind": "inspect", "acquisition_id": acquisition })).await;
    let aligned = aligned["result"]["inspection_id"].as_str().unwrap();
    app.admin.post(&format!("inspections/{aligned}/thresholds"), wish(9.5)).await.problem(404, "no-likelihood");
    app.admin.get(&format!("inspections/{aligned}/thresholds")).await.problem(404, "no-likelihood");
    app.admin.post(&format!("inspections/{}/thresholds", new_id()), wish(9.5)).await.problem(404, "not-found");
}
