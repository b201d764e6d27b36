//! Thresholds apart from scores: tried on past inspections, set with who and why, and used from then on.

use crate::app::{TestApp, new_id};
use crate::toy_engine::{TRAINED_THRESHOLD, toy_budget};
use ropescope::pipeline::Budget;
use serde_json::{Value, json};
use std::sync::atomic::Ordering;

/// Metres as JSON carries them, to the micrometre.
fn um(metres: &Value) -> i64 {
    (metres.as_f64().unwrap() * 1e6).round() as i64
}

#[tokio::test]
async fn another_threshold_is_tried_on_past_inspections_without_a_job() {
    let app = TestApp::start().await;
    let (_, model, inspection) = app.admin.inspected().await;
    let path = format!("models/{model}/threshold-preview");
    let jobs = app.admin.get("jobs").await.ok(200);
    let defect = app.admin.get(&format!("inspections/{inspection}/defects")).await.ok(200)["items"][0].clone();

    // Higher: the only defect, 9.0 on line 42, is gone; 25 mm on either side of it no longer need to be looked at.
    const LOOKED_AT_UM: i64 = 29_300;
    let higher = app.admin.post(&path, json!({ "line_score": 9.5 })).await.ok(200);
    let past = &higher["inspections"][0];
    assert_eq!(
        (&past["inspection_id"], &past["threshold"]["line_score"]),
        (&json!(inspection), &json!(TRAINED_THRESHOLD))
    );
    assert_eq!(um(&past["inspected_m"]), 20_000, "of 30 mm the middle 10 mm have no score");
    assert_eq!((um(&past["before"]["reinspect_m"]), &past["before"]["defects"]), (LOOKED_AT_UM, &json!(1)));
    assert_eq!((um(&past["after"]["reinspect_m"]), &past["after"]["defects"]), (0, &json!(0)));
    assert_eq!(past["closed"][0]["defect_id"], defect["defect_id"]);
    assert_eq!(past["opened"], json!([]));

    // Lower: the last line of the rope has 5.0.
    let lower = app.admin.post(&path, json!({ "line_score": 4 })).await.ok(200);
    let past = &lower["inspections"][0];
    assert_eq!(
        (um(&past["after"]["reinspect_m"]), &past["after"]["defects"]),
        (30_000, &json!(2)),
        "two contexts overlap"
    );
    let opened = &past["opened"][0];
    assert_eq!(
        (um(&opened["from_m"]), um(&opened["to_m"]), &opened["peak_score"]),
        (5_029_900, 5_030_000, &json!(5.0))
    );
    assert_eq!(past["closed"], json!([]));

    // With its context the defect is more than all of the 20 mm: no budget allows it.
    let budget = app.admin.post(&path, json!({ "reinspect_m_per_100m": 100 })).await.ok(200);
    assert!((budget["line_score"].as_f64().unwrap() - 9.0).abs() < 1e-6, "{budget}");
    assert_eq!(um(&budget["inspections"][0]["after"]["reinspect_m"]), 0);

    assert_eq!(app.admin.get("jobs").await.ok(200), jobs, "nothing was computed anew");
    app.admin.post(&path, json!({ "line_score": -1 })).await.problem(422, "out-of-range");
    app.admin.post(&path, json!({ "line_score": 5, "inspections": 21 })).await.problem(422, "out-of-range");
    app.admin.post(&path, json!({ "reinspect_m_per_100m": 101 })).await.problem(422, "out-of-range");
    app.admin.post(&path, json!({})).await.problem(400, "malformed-body");
    let unknown = format!("models/{}/threshold-preview", new_id());
    app.admin.post(&unknown, json!({ "line_score": 5 })).await.problem(404, "not-found");
}

#[tokio::test]
async fn a_budget_of_metres_is_one_for_all_inspections_that_are_asked_for() {
    let app = TestApp::start().await;
    let (rope, model, first) = app.admin.inspected().await;
    let acquisition = app.admin.complete_acquisition(&rope).await;
    let inspect = json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model });
    let second = app.admin.run(inspect).await["result"]["inspection_id"].as_str().unwrap().to_owned();
    // The first has 9.0 within 25 mm of 293 lines and 5.0 of the other 7, on 20 mm that were inspected; the second one has 1.0 on 30 mm.
    let scores: Vec<u8> = [1.0_f32; 300].iter().flat_map(|score| score.to_le_bytes()).collect();
    std::fs::write(app.data.path().join(format!("inspections/{second}/line_scores_view0.f32")), scores).unwrap();
    let path = format!("models/{model}/threshold-preview");
    let tried = async |inspections: u32| {
        app.admin.post(&path, json!({ "reinspect_m_per_100m": 59, "inspections": inspections })).await.ok(200)
    };
    let both = tried(2).await;
    assert_eq!(both["line_score"], json!(5.0), "29.3 mm of 50 are allowed, all 30 are not");
    let after: Vec<(&Value, i64)> = both["inspections"]
        .as_array()
        .unwrap()
        .iter()
        .map(|past| (&past["inspection_id"], um(&past["after"]["reinspect_m"])))
        .collect();
    assert_eq!(after, [(&json!(second), 0), (&json!(first), 29_300)]);
    assert_eq!(tried(1).await["line_score"], json!(1.0), "the newest alone");
}

#[tokio::test]
async fn a_budget_of_false_defects_finds_its_threshold_by_the_tail_of_intact_rope_and_says_how_sure_that_is() {
    let app = TestApp::start().await;
    let (_, model, _) = app.admin.inspected().await;
    let path = format!("models/{model}/threshold-preview");
    let near = |value: &Value, truth: f64| (value.as_f64().unwrap() / truth - 1.0).abs() < 1e-6;
    let trained = toy_budget(Budget::default());
    for (wish, places) in [(2.0, 1), (100.0, 1)] {
        let level = trained.at(wish).unwrap();
        let tried = app.admin.post(&path, json!({ "false_defects_per_100m": wish })).await.ok(200);
        assert!(near(&tried["line_score"], level.line_score), "{tried}");
        let costs = &tried["on_intact_rope"];
        assert_eq!(costs["false_defects_per_100m"], json!(wish));
        assert!(near(&costs["at_least_per_100m"], level.at_least_per_100m), "{costs}");
        assert!(near(&costs["at_most_per_100m"], level.at_most_per_100m), "{costs}");
        assert_eq!(tried["inspections"][0]["after"]["defects"], json!(places));
        let back = app.admin.post(&path, json!({ "line_score": tried["line_score"] })).await.ok(200);
        assert!(near(&back["on_intact_rope"]["at_most_per_100m"], level.at_most_per_100m), "{back}");
    }
    let two = trained.at(2.0).unwrap();
    assert!(two.at_least_per_100m < 1.0 && two.at_most_per_100m > 4.0, "40 peaks tell little: {two:?}");
    let lowest = app.admin.post(&path, json!({ "line_score": 2 })).await.ok(200);
    assert_eq!(lowest["on_intact_rope"], Value::Null, "under the tail there is no law");
    for wrong in [0.05, 101.0] {
        let problem =
            app.admin.post(&path, json!({ "false_defects_per_100m": wrong })).await.problem(422, "out-of-range");
        assert_eq!(problem["limit"], json!({ "min": 0.1, "max": 100.0 }));
    }
    let both = json!({ "false_defects_per_100m": 2, "line_score": 5 });
    app.admin.post(&path, both).await.problem(400, "malformed-body");
}

#[tokio::test]
async fn a_model_of_an_earlier_version_says_that_it_knows_no_threshold_for_false_defects() {
    let app = TestApp::start().await;
    app.engine.earlier.store(true, Ordering::SeqCst);
    let (_, model, _) = app.admin.inspected().await;
    let path = format!("models/{model}/threshold-preview");
    let problem =
        app.admin.post(&path, json!({ "false_defects_per_100m": 2 })).await.problem(422, "model-without-tail");
    assert!(problem["detail"].as_str().unwrap().contains("train anew, or give line_score"), "{problem}");
    let tried = app.admin.post(&path, json!({ "line_score": 7 })).await.ok(200);
    assert_eq!((&tried["on_intact_rope"], &tried["line_score"]), (&Value::Null, &json!(7.0)));
}

#[tokio::test]
async fn a_threshold_that_was_set_holds_for_later_inspections_and_says_who_and_why() {
    let app = TestApp::start().await;
    let (rope, model, earlier) = app.admin.inspected().await;
    let path = format!("models/{model}/thresholds");
    let trained = app.admin.get(&path).await.ok(200)["items"].clone();
    assert_eq!((&trained[0]["version"], &trained[0]["line_score"]), (&json!(0), &json!(TRAINED_THRESHOLD)));

    let wish = json!({ "line_score": 4.5, "by": "A. Inspector", "reason": "old rope" });
    app.admin.call("PUT", &format!("{path}/2"), wish.clone()).await.problem(409, "threshold-moved");
    let set = app.admin.call("PUT", &format!("{path}/1"), wish.clone()).await.ok(201);
    assert_eq!(app.admin.call("PUT", &format!("{path}/1"), wish).await.ok(200), set);
    let other = json!({ "line_score": 7, "by": "B. Inspector", "reason": "new rope" });
    let problem = app.admin.call("PUT", &format!("{path}/1"), other).await.problem(409, "threshold-moved");
    assert_eq!(problem["limit"], 2);
    assert_eq!(app.admin.get(&path).await.ok(200)["items"], json!([set, trained[0]]));

    assert!(
        (set["look_again_line_score"].as_f64().unwrap() - 3.3).abs() < 1e-9,
        "1.2 under it, as the trained one: {set}"
    );
    let over = json!({ "line_score": 5, "look_again_line_score": 6, "reason": "x" });
    app.admin.call("PUT", &format!("{path}/2"), over).await.problem(422, "out-of-range");

    let acquisition = app.admin.complete_acquisition(&rope).await;
    let inspect = async |body: Value| {
        let job = app.admin.run(body).await;
        let id = job["result"]["inspection_id"].as_str().unwrap_or_else(|| panic!("{job}")).to_owned();
        app.admin.get(&format!("inspections/{id}")).await.ok(200)["summary"]["threshold"].clone()
    };
    let body = json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model });
    let threshold = inspect(body.clone()).await;
    assert_eq!(threshold["line_score"], 4.5);
    assert_eq!(threshold["origin"], "version 1 for this model, set by A. Inspector: old rope");
    let mut own = body;
    own["threshold"] = json!(8.0);
    assert_eq!(inspect(own).await["line_score"], 8.0, "a job may bring its own");
    let before = app.admin.get(&format!("inspections/{earlier}")).await.ok(200);
    assert_eq!(before["summary"]["threshold"]["line_score"], TRAINED_THRESHOLD, "what was judged stays judged");

    let nobody = json!({ "line_score": 5.0, "reason": "" });
    app.admin.call("PUT", &format!("{path}/2"), nobody).await.problem(422, "out-of-range");
    app.admin
        .call("PUT", &format!("models/{}/thresholds/1", new_id()), json!({ "line_score": 5.0, "reason": "x" }))
        .await
        .problem(404, "not-found");
}

#[tokio::test]
async fn places_to_look_at_again_are_listed_apart_from_defects_and_can_be_confirmed() {
    let app = TestApp::start().await;
    let (_, _, inspection) = app.admin.inspected().await;
    let found = async |query: &str| {
        let list = app.admin.get(&format!("inspections/{inspection}/defects{query}")).await.ok(200);
        list["items"].as_array().unwrap().clone()
    };
    let (defects, again, both) = (found("").await, found("?level=look_again").await, found("?level=any").await);
    assert_eq!((defects.len(), &defects[0]["level"]), (1, &json!("alarm")));
    assert_eq!((again.len(), &again[0]["level"], &again[0]["peak_score"]), (1, &json!("look_again"), &json!(5.0)));
    assert_eq!(both, [defects, again.clone()].concat());
    let id = again[0]["defect_id"].as_str().unwrap();
    let surface_alarms = async || {
        app.admin.get(&format!("inspections/{inspection}/surface-alarms")).await.ok(200)["surface_alarms"].clone()
    };
    assert_eq!(surface_alarms().await, json!(1));
    let verdict = json!({ "verdict": "confirmed", "by": "A. Inspector" });
    assert_eq!(app.admin.post(&format!("defects/{id}/verdict"), verdict).await.ok(200)["state"], "confirmed");
    assert_eq!(surface_alarms().await, json!(2), "what was confirmed counts, whatever its level");
    let summary = app.admin.get(&format!("inspections/{inspection}")).await.ok(200)["summary"].clone();
    assert_eq!((&summary["defects"], &summary["look_again"]), (&json!(1), &json!(1)));
    assert_eq!(summary["threshold"]["look_again_line_score"], json!(4.8));
    app.admin.get(&format!("inspections/{inspection}/defects?level=all")).await.problem(400, "malformed-query");
}

#[tokio::test]
async fn a_training_is_told_what_false_alarms_may_cost() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let acquisition = app.admin.complete_acquisition(&rope).await;
    let train = |budget: Value| json!({ "kind": "train", "acquisition_id": acquisition, "budget": budget });
    let job = app.admin.run(train(json!({ "reinspect_m_per_100m": 0.6 }))).await;
    let model = app.admin.get(&format!("models/{}", job["result"]["model_id"].as_str().unwrap())).await.ok(200);
    let fit = &model["trained_on"]["budget"];
    assert_eq!(fit["budget"], json!({ "reinspect_m_per_100m": 0.6 }));
    assert!((fit["alarm"]["false_defects_per_100m"].as_f64().unwrap() - 10.0).abs() < 1e-6, "{fit}");
    assert!(fit["alarm"]["at_least_per_100m"].as_f64() < fit["alarm"]["at_most_per_100m"].as_f64());
    assert_eq!(model["trained_on"]["learning_curve"][1]["metres"], json!(1.0));
    let sentence = model["trained_on"]["was_it_enough"].as_str().unwrap();
    assert!(sentence.starts_with("more rope would help: the last 0.5 m"), "{sentence}");
    for wrong in [json!({ "false_defects_per_100m": 0.01 }), json!({ "reinspect_m_per_100m": 50 })] {
        let problem = app.admin.post("jobs", train(wrong)).await.problem(422, "out-of-range");
        assert_eq!(problem["field"], "budget");
    }
    app.admin.post("jobs", train(json!({ "false_defects": 2 }))).await.problem(400, "malformed-body");
}

#[tokio::test]
async fn a_training_is_told_who_chooses_the_bandwidths_and_the_model_says_what_they_are() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let acquisition = app.admin.complete_acquisition(&rope).await;
    let train = |key: &str, bandwidths: Value| json!({ "kind": "train", "acquisition_id": acquisition, "idempotency_key": key, "bandwidths": bandwidths });
    for (key, asked, by, gained) in [
        ("a", json!("fixed"), "fixed", 0.0),
        ("b", json!("held-out"), "held-out", 0.05),
        ("c", json!(null), "held-out", 0.05),
    ] {
        let job = app.admin.run(train(key, asked)).await;
        let model = app.admin.get(&format!("models/{}", job["result"]["model_id"].as_str().unwrap())).await.ok(200);
        let bandwidths = &model["trained_on"]["bandwidths"];
        assert_eq!((&bandwidths["by"], &bandwidths["gained_nats_per_pixel"]), (&json!(by), &json!(gained)));
        assert_eq!((&bandwidths["gray_bins"], &bandwidths["wire_phase_sigma_bins"]), (&json!(32), &json!(0.8)));
    }
    app.admin.post("jobs", train("c", json!("held-out"))).await.ok(202);
    app.admin.post("jobs", train("c", json!("fixed"))).await.problem(409, "idempotency-key-reused");
    app.admin.post("jobs", train("d", json!("by eye"))).await.problem(400, "malformed-body");
}

#[tokio::test]
async fn a_model_that_no_longer_fits_is_said_with_figures_and_counted() {
    let app = TestApp::start().await;
    assert!(app.admin.get("/metrics").await.text().contains("ropescope_ropes_with_unfit_model 0"));
    let (_, _, inspection) = app.admin.inspected().await;
    let fit = app.admin.get(&format!("inspections/{inspection}")).await.ok(200)["summary"]["fit"].clone();
    assert_eq!((&fit["fits"], &fit["false_defects_per_100m"]), (&json!(false), &json!(31.4)));
    assert_eq!(fit["cannot_tell"], json!(false), "it is sure that it does not");
    let warning = fit["warning"].as_str().unwrap();
    assert!(warning.contains("31 false defects per 100 m (20 to 48 with 95 %)"), "{warning}");
    assert!(app.admin.get("/metrics").await.text().contains("ropescope_ropes_with_unfit_model 1"));
}
