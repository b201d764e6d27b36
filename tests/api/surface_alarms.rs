//! Surface alarms over windows of rope.

use crate::app::{TestApp, new_id};
use serde_json::{Value, json};

fn unlimited(unit: &str, length: f64) -> Value {
    json!({ "unit": unit, "length": length, "most_surface_alarms": null })
}

#[tokio::test]
async fn a_rope_has_the_usual_windows_until_others_are_set() {
    let app = TestApp::start().await;
    let path = format!("ropes/{}/windows", app.admin.rope().await);
    let usual = app.admin.get(&path).await.ok(200);
    let mut expected: Vec<Value> = [6.0, 30.0, 40.0, 500.0].map(|n| unlimited("diameter", n)).into();
    expected.push(unlimited("lay", 1.0));
    assert_eq!(usual["windows"], json!(expected));
    let own =
        json!({ "windows": [{ "unit": "diameter", "length": 6.0, "most_surface_alarms": 2 }, unlimited("lay", 2.0)] });
    assert_eq!(app.admin.call("PUT", &path, own.clone()).await.ok(200), own);
    assert_eq!(app.admin.get(&path).await.ok(200), own);
    let twice = json!({ "windows": [unlimited("lay", 2.0), unlimited("lay", 2.0)] });
    app.admin.call("PUT", &path, twice).await.problem(422, "out-of-range");
    app.admin.call("PUT", &path, json!({ "windows": [unlimited("lay", 0.0)] })).await.problem(422, "out-of-range");
    app.admin.call("PUT", &path, json!({ "windows": [unlimited("metre", 1.0)] })).await.problem(400, "malformed-body");
    assert_eq!(app.admin.call("PUT", &path, json!({ "windows": [] })).await.ok(200), usual);
    app.admin.get(&format!("ropes/{}/windows", new_id())).await.problem(404, "not-found");
}

#[tokio::test]
async fn surface_alarms_are_counted_per_window_with_what_was_not_covered_until_they_are_dismissed() {
    let app = TestApp::start().await;
    let (rope, _, inspection) = app.admin.inspected().await;
    // The rope is 30 mm long and 20.46 mm thick: half a diameter is 10.23 mm. Its defect lies from 4.0 to 4.5 mm; from 10 to 20 mm
    // it was too dark.
    let windows = json!({ "windows": [
        { "unit": "diameter", "length": 0.5, "most_surface_alarms": 0 }, { "unit": "lay", "length": 1.0, "most_surface_alarms": 1 }] });
    app.admin.call("PUT", &format!("ropes/{rope}/windows"), windows).await.ok(200);
    let path = format!("inspections/{inspection}/surface-alarms");
    let found = app.admin.get(&path).await.ok(200);
    assert_eq!((&found["surface_alarms"], &found["not_covered"][0]["reason"]), (&json!(1), &json!("too dark")));
    let half = &found["windows"][0];
    assert_eq!((&half["length_m"], &half["length_origin"]), (&json!(0.01023), &json!("designed")));
    let of = |key: &str| half["series"].as_array().unwrap().iter().map(|w| w[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("surface_alarms"), [1, 0, 0]);
    assert_eq!(of("over_limit"), [true, false, false]);
    assert_eq!(of("not_covered_reasons"), [json!(["too dark"]), json!(["too dark"]), json!([])]);
    let dark_um: Vec<i64> =
        of("not_covered_view_m").iter().map(|m| (m.as_f64().unwrap() * 1e6).round() as i64).collect();
    assert_eq!(dark_um, [230, 9770, 0]);
    assert_eq!((&half["worst"]["surface_alarms"], &half["worst"]["over_limit"]), (&json!(1), &json!(true)));
    // Lays of 137 and 139 mm were measured; the rope is shorter, so one window is all of it.
    let lay = &found["windows"][1];
    assert_eq!((&lay["length_m"], &lay["length_origin"]), (&json!(0.138), &json!("measured")));
    assert_eq!((lay["series"].as_array().unwrap().len(), &lay["worst"]["over_limit"]), (1, &json!(false)));

    let csv = app.admin.get(&format!("{path}?format=csv")).await;
    assert!(csv.header("content-type").starts_with("text/csv"));
    assert_eq!(csv.text().lines().count(), 1 + 4 + 2, "a head, and worst and series of both lengths");
    assert!(csv.text().starts_with("unit,length,length_m,place,from_m,to_m,surface_alarms,"), "{}", csv.text());

    let defects = app.admin.get(&format!("inspections/{inspection}/defects")).await.ok(200);
    let verdict = format!("defects/{}/verdict", defects["items"][0]["defect_id"].as_str().unwrap());
    app.admin.post(&verdict, json!({ "verdict": "dismissed" })).await.ok(200);
    assert_eq!(app.admin.get(&path).await.ok(200)["windows"][0]["worst"]["surface_alarms"], 0);
}

#[tokio::test]
async fn without_a_model_nothing_is_counted_rather_than_none() {
    let app = TestApp::start().await;
    let acquisition = app.admin.complete_acquisition(&app.admin.rope().await).await;
    let job = app.admin.run(json!({ "kind": "inspect", "acquisition_id": acquisition })).await;
    let inspection = job["result"]["inspection_id"].as_str().unwrap();
    app.admin.get(&format!("inspections/{inspection}/surface-alarms")).await.problem(404, "no-likelihood");
}
