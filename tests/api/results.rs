//! What inspections answer: lay lengths, defects, scores, pictures, history.

use crate::app::{LINES, SENSOR_PX, TestApp, new_id};
use ropescope::store::tokens::Role;
use serde_json::{Value, json};

#[tokio::test]
async fn models_are_versioned_and_say_what_they_were_trained_on() {
    let app = TestApp::start().await;
    let (rope, model, _) = app.admin.inspected().await;
    let acquisition = app.admin.complete_acquisition(&rope).await;
    app.admin.run(json!({ "kind": "train", "acquisition_id": acquisition, "from_m": 5.0 })).await;
    let models = app.admin.get(&format!("models?rope_id={rope}")).await.ok(200);
    assert_eq!(
        models["items"].as_array().unwrap().iter().map(|m| m["version"].as_u64().unwrap()).collect::<Vec<_>>(),
        [2, 1]
    );
    assert_eq!(models["items"][0]["trained_on"]["acquisition_id"], acquisition);
    assert_eq!(models["items"][0]["trained_on"]["from_m"], 5.0);
    let file = app.admin.get(&format!("models/{model}/file")).await;
    assert_eq!(file.bytes, b"a model");
    let again = app.admin.request("GET", &format!("models/{model}/file")).header("if-none-match", file.header("etag"));
    assert_eq!(app.admin.send(again).await.status, 304);
}

#[tokio::test]
async fn lay_lengths_come_as_rows_buckets_and_csv_and_gaps_have_reasons() {
    let app = TestApp::start().await;
    let (_, _, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/lay-lengths");
    let rows = app.admin.get(&path).await.ok(200);
    assert_eq!(rows["rows"].as_array().unwrap().len(), 3);
    assert_eq!(
        (&rows["rows"][0]["strand_lay_mm"], &rows["rows"][0]["wires"][5]["lay_mm"]),
        (&json!(137.0), &json!(-70.5))
    );
    assert_eq!((&rows["rows"][1]["strand_lay_mm"], &rows["rows"][1]["reason"]), (&Value::Null, &json!("too dark")));
    let (row, gap) = (&rows["rows"][0], &rows["rows"][1]);
    for (field, value) in [
        ("strand_phase_sd_rad", json!(0.002)),
        ("strand_quality", json!("good")),
        ("strand_spread_rad", json!(0.01)),
        ("strand_spread_sd_rad", json!(0.001)),
        ("diameter_mm", json!(20.0)),
        ("diameter_sd_mm", json!(0.2)),
        ("diameter_quality", json!("uncertain")),
        ("ovality_percent", json!(0.8)),
        ("ovality_sd_percent", json!(0.3)),
    ] {
        assert_eq!((&row[field], &gap[field]), (&value, &Value::Null), "{field}");
    }
    assert_eq!((&row["wires"][5]["phase_sd_rad"], &row["wires"][5]["quality"]), (&json!(0.004), &json!("uncertain")));
    let one = app.admin.get(&format!("{path}?from_m=5.022&view=0")).await.ok(200);
    assert_eq!((one["rows"].as_array().unwrap().len(), &one["rows"][0]["view"]), (1, &json!(0)));
    let buckets = app.admin.get(&format!("{path}?buckets=3")).await.ok(200);
    assert!(buckets["rows"].is_null());
    let buckets = buckets["buckets"].as_array().unwrap();
    assert_eq!(buckets[0]["strand_lay_mm"]["mean"], 137.0);
    assert_eq!((&buckets[0]["diameter_mm"]["mean"], &buckets[1]["diameter_mm"]), (&json!(20.0), &Value::Null));
    assert_eq!((&buckets[1]["strand_lay_mm"], &buckets[1]["reason"]), (&Value::Null, &json!("too dark")));
    let csv = app.admin.send(app.admin.request("GET", &path).header("accept", "text/csv")).await;
    assert!(csv.header("content-type").starts_with("text/csv"));
    assert!(csv.text().starts_with("view,first_line,last_line,position_m,strand_lay_mm"), "{}", csv.text());
    assert_eq!(csv.text().lines().count(), 4);
    assert_eq!(app.admin.get(&format!("{path}?buckets=2&format=csv")).await.text().lines().count(), 3);
    app.admin.get(&format!("{path}?view=1")).await.problem(404, "view-out-of-range");
    app.admin.get(&format!("{path}?view=x")).await.problem(400, "malformed-query");
    app.admin.get(&format!("{path}?buckets=5001")).await.problem(422, "out-of-range");
    app.admin.get(&format!("{path}?from_m=2&to_m=1")).await.problem(422, "out-of-range");
    app.admin.get(&format!("{path}?from_m=NaN")).await.problem(422, "out-of-range");
}

#[tokio::test]
async fn a_defect_is_confirmed_once_and_carries_its_ticket() {
    let app = TestApp::start().await;
    let (rope, _, inspection) = app.admin.inspected().await;
    let list = app.admin.get(&format!("inspections/{inspection}/defects")).await.ok(200);
    let defect = &list["items"][0];
    assert_eq!((&defect["state"], &defect["strand"], &defect["peak_score"]), (&json!("open"), &json!(2), &json!(9.0)));
    let csv = app.admin.get(&format!("inspections/{inspection}/defects?format=csv")).await.text();
    assert_eq!(csv.lines().count(), 2);
    let id = defect["defect_id"].as_str().unwrap();
    let verdict = format!("defects/{id}/verdict");
    let confirmed =
        app.admin.post(&verdict, json!({ "verdict": "confirmed", "by": "ab", "comment": "wire" })).await.ok(200);
    assert_eq!((&confirmed["state"], &confirmed["verdict"]["by"]), (&json!("confirmed"), &json!("ab")));
    assert_eq!(app.admin.post(&verdict, json!({ "verdict": "confirmed" })).await.ok(200), confirmed);
    app.admin.post(&verdict, json!({ "verdict": "dismissed" })).await.problem(409, "verdict-differs");
    let receiver = app.caller(Role::Ticketing).await;
    let ticket = json!({ "number": "4711", "url": "https://tickets.example/4711", "state": "open" });
    let ticketed = receiver.call("PUT", &format!("defects/{id}/ticket"), ticket.clone()).await.ok(200);
    assert_eq!(ticketed["ticket"], ticket);
    let bad = json!({ "number": "1", "url": "javascript:alert(1)", "state": "open" });
    receiver.call("PUT", &format!("defects/{id}/ticket"), bad).await.problem(422, "out-of-range");
    let found = app.admin.get(&format!("defects?rope_id={rope}&state=confirmed")).await.ok(200);
    assert_eq!(found["items"], json!([ticketed]));
    assert_eq!(app.admin.get("defects?state=open").await.ok(200)["items"], json!([]));
    app.admin.get(&format!("defects/{}", new_id())).await.problem(404, "not-found");
}

#[tokio::test]
async fn a_defect_at_the_ticket_level_queues_its_event_with_the_inspection() {
    let app = TestApp::start().await;
    let (rope, model, _) = app.admin.inspected().await;
    let events = async || -> i64 {
        let reader = app.service.app.store.reader();
        sqlx::query_scalar("select count(*) from outbox_event").fetch_one(reader).await.unwrap()
    };
    assert_eq!(events().await, 0);
    app.admin.call("PATCH", &format!("ropes/{rope}/ticketing"), json!({ "ticket_level": 9.0 })).await.ok(200);
    let acquisition = app.admin.complete_acquisition(&rope).await;
    app.admin.run(json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model })).await;
    assert_eq!(events().await, 1);
}

#[tokio::test]
async fn line_scores_keep_their_peaks_and_admit_their_gaps() {
    let app = TestApp::start().await;
    let (rope, _, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/line-scores");
    let scores = app.admin.get(&format!("{path}?view=0&buckets=3")).await.ok(200);
    let max: Vec<_> = scores["buckets"].as_array().unwrap().iter().map(|b| b["max"].clone()).collect();
    assert_eq!(max, [json!(9.0), Value::Null, json!(5.0)]);
    assert_eq!(scores["buckets"][1]["lines_not_inspected"], LINES);
    app.admin.get(&path).await.problem(400, "malformed-query");
    app.admin.get(&format!("{path}?view=3")).await.problem(404, "view-out-of-range");
    app.admin.get(&format!("{path}?view=0&from_line=500")).await.problem(422, "out-of-range");
    let acquisition = app.admin.complete_acquisition(&rope).await;
    let job = app.admin.run(json!({ "kind": "inspect", "acquisition_id": acquisition })).await;
    let aligned = job["result"]["inspection_id"].as_str().unwrap();
    app.admin.get(&format!("inspections/{aligned}/line-scores?view=0")).await.problem(404, "no-likelihood");
    app.admin.get(&format!("inspections/{aligned}/views/0/likelihood.png")).await.problem(404, "no-likelihood");
}

#[tokio::test]
async fn pictures_show_any_range_scaled_and_small_defects_stay_dark() {
    let app = TestApp::start().await;
    let (_, _, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/views/0");
    let whole = app.admin.get(&format!("{path}/likelihood.png")).await;
    let picture = image::load_from_memory(&whole.bytes).unwrap().to_luma8();
    assert_eq!(picture.dimensions(), (SENSOR_PX, 3 * LINES));
    let small = app.admin.get(&format!("{path}/likelihood.png?width=4&height=3")).await;
    let picture = image::load_from_memory(&small.bytes).unwrap().to_luma8();
    assert_eq!((picture.dimensions(), picture.get_pixel(0, 0).0[0], picture.get_pixel(1, 0).0[0]), ((4, 3), 3, 200));
    let etag = small.header("etag").to_owned();
    let again =
        app.admin.request("GET", &format!("{path}/likelihood.png?width=4&height=3")).header("if-none-match", etag);
    assert_eq!(app.admin.send(again).await.status, 304);
    let image = app.admin.get(&format!("{path}/image.png?from_m=5.01&to_m=5.02")).await;
    let image = image::load_from_memory(&image.bytes).unwrap().to_luma8();
    let frame = image::load_from_memory(&crate::app::png(1)).unwrap().to_luma8();
    assert!(image == frame, "metres 5.01 to 5.02 are the lines of frame 1");
    let image = app.admin.get(&format!("{path}/image.png?from_m=4.95&to_m=5.01")).await;
    let image = image::load_from_memory(&image.bytes).unwrap().to_luma8();
    let frame = image::load_from_memory(&crate::app::png(0)).unwrap().to_luma8();
    assert!(image == frame, "the rope begins at 5.0 m");
    app.admin.get(&format!("{path}/image.png?from_line=300")).await.problem(422, "out-of-range");
    for name in ["from_line", "to_line"] {
        let beyond = format!("{path}/image.png?{name}=9223372036854775808"); // 2^63
        let problem = app.admin.get(&beyond).await.problem(400, "malformed-query");
        assert!(problem["detail"].as_str().unwrap().contains("65536000000"), "{problem}");
    }
    assert_eq!(app.admin.get(&format!("{path}/image.png?to_line=65536000000")).await.status, 200);
    app.admin.get(&format!("{path}/image.png?width=8193")).await.problem(422, "out-of-range");
    app.admin.get(&format!("{path}/image.png?from_line=1&from_m=2")).await.problem(400, "malformed-query");
    app.admin.get(&format!("inspections/{inspection}/views/9/image.png")).await.problem(404, "view-out-of-range");
}

#[tokio::test]
async fn a_picture_of_negative_metres_begins_where_the_rope_does() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let body = json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "views": [{ "angle_deg": 0.0, "frames": 3 }],
        "start_m": -12.0 });
    let id = app.admin.post("acquisitions", body).await.ok(201)["id"].as_str().unwrap().to_owned();
    for n in 0..3 {
        app.admin.put_frame(&id, 0, n, crate::app::png(n as u8)).await.ok(201);
    }
    app.admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
    let job = app.admin.run(json!({ "kind": "inspect", "acquisition_id": id })).await;
    let inspection = job["result"]["inspection_id"].as_str().unwrap_or_else(|| panic!("{job}"));
    let lines = async |to_m: &str| {
        let path = format!("inspections/{inspection}/views/0/image.png?from_m=-12.050&to_m={to_m}");
        image::load_from_memory(&app.admin.get(&path).await.bytes).unwrap().height()
    };
    // As the event of a defect in the first 5 mm links it, with 5 cm on either side: more than there is.
    assert_eq!((lines("-11.945").await, lines("-11.996").await), (3 * LINES, 40));
}

#[tokio::test]
async fn history_puts_the_dates_of_a_rope_on_one_grid() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    for month in ["2026-01", "2026-02"] {
        let body = json!({ "rope_id": rope, "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "views": [{ "angle_deg": 0.0 }],
            "acquired_at": format!("{month}-01T10:00:00Z") });
        let id = app.admin.post("acquisitions", body).await.ok(201)["id"].as_str().unwrap().to_owned();
        for n in 0..3 {
            app.admin.put_frame(&id, 0, n, crate::app::png(n as u8)).await.ok(201);
        }
        app.admin.post(&format!("acquisitions/{id}/completion"), json!({ "views": [{ "frames": 3 }] })).await.ok(200);
        for _ in 0..2 {
            app.admin.run(json!({ "kind": "inspect", "acquisition_id": id })).await; // only the last one counts
        }
    }
    let ropeway = app.admin.get(&format!("ropes/{rope}")).await.ok(200)["ropeway_id"].as_str().unwrap().to_owned();
    for path in [format!("ropes/{rope}"), format!("ropeways/{ropeway}")] {
        let path = format!("{path}/lay-length-history");
        let history = app.admin.get(&format!("{path}?buckets=3")).await.ok(200);
        let inspections = history["ropes"][0]["inspections"].as_array().unwrap();
        let dates: Vec<_> = inspections.iter().map(|i| i["acquired_at"].as_str().unwrap()).collect();
        assert_eq!(dates, ["2026-01-01T10:00:00Z", "2026-02-01T10:00:00Z"]);
        assert_eq!(inspections[0]["buckets"][0], inspections[1]["buckets"][0]);
        assert_eq!(inspections[0]["buckets"][1]["reason"], "too dark");
        let february = app.admin.get(&format!("{path}?from=2026-01-15T00:00:00Z")).await.ok(200);
        assert_eq!(february["ropes"][0]["inspections"].as_array().unwrap().len(), 1);
        let csv = app.admin.get(&format!("{path}?buckets=3&format=csv")).await.text();
        assert_eq!(csv.lines().count(), 7);
        app.admin.get(&format!("{path}?from=monday")).await.problem(422, "out-of-range");
    }
    app.admin.get(&format!("ropes/{}/lay-length-history", new_id())).await.problem(404, "not-found");
}

#[tokio::test]
async fn a_defect_says_where_round_the_rope_it_is_how_it_ranks_and_what_it_is_likely_to_be() {
    let app = TestApp::start().await;
    let (_, _, inspection) = app.admin.inspected().await;
    let path = format!("inspections/{inspection}/defects");
    let defect = app.admin.get(&path).await.ok(200)["items"][0].clone();
    assert_eq!((&defect["angle_deg"], &defect["rank"]), (&json!(300.0), &json!(1)));
    let suggestion = &defect["suggestion"];
    assert_eq!((&suggestion["kind"], &suggestion["why"]), (&json!("gap"), &json!("dark over 4 mm")));
    assert_eq!(suggestion["area_mm2"], json!(5.5));
    let csv = app.admin.get(&format!("{path}?format=csv&level=any")).await.text();
    let column = |row: usize, name: &str| {
        let at = csv.lines().next().unwrap().split(',').position(|head| head == name).unwrap();
        csv.lines().nth(row).unwrap().split(',').nth(at).unwrap().to_owned()
    };
    assert_eq!(
        (column(1, "level").as_str(), column(1, "kind").as_str(), column(1, "area_mm2").as_str()),
        ("alarm", "gap", "5.5")
    );
    assert_eq!((column(2, "level").as_str(), column(2, "kind").as_str()), ("look_again", ""), "no figures, no kind");
}
