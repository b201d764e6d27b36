//! Retention: frames go when their time is over, and never as long as somebody may need them.

use crate::app::{TestApp, png};
use serde_json::{Value, json};

const DAY_MS: i64 = 86_400_000;

async fn keep(app: &TestApp, rope: &str, days: Value) {
    let ropeway = app.admin.get(&format!("ropes/{rope}")).await.ok(200)["ropeway_id"].as_str().unwrap().to_owned();
    let kept =
        app.admin.call("PUT", &format!("ropeways/{ropeway}/storage"), json!({ "keep_days": days })).await.ok(200);
    assert_eq!(kept["keep_days"], days);
}

#[tokio::test]
async fn evidence_of_a_defect_stays_until_it_is_dismissed_and_then_frames_go_but_not_results() {
    let app = TestApp::start().await;
    let (rope, model, inspection) = app.admin.inspected().await;
    keep(&app, &rope, json!(30)).await;
    let store = &app.service.app.store;
    let later = app.service.app.now_ms() + 31 * DAY_MS;
    assert_eq!(store.overdue(later - 2 * DAY_MS).await.unwrap(), []);
    let overdue = store.overdue(later).await.unwrap();
    assert_eq!((overdue.len(), overdue[0].frames, overdue[0].age_days), (1, 3, 31));
    assert!(overdue[0].kept_because.as_ref().unwrap().contains("defects"));
    assert!(!store.remove_frames(overdue[0].id, later).await.unwrap(), "evidence is not removed");
    let defect =
        app.admin.get(&format!("inspections/{inspection}/defects")).await.ok(200)["items"][0]["defect_id"].clone();
    let verdict = json!({ "verdict": "dismissed", "by": "test" });
    let defect = format!("defects/{}", defect.as_str().unwrap());
    app.admin.post(&format!("{defect}/verdict"), verdict).await.ok(200);
    assert!(store.remove_frames(overdue[0].id, later).await.unwrap());
    assert_eq!(store.overdue(later).await.unwrap(), []);

    let id = overdue[0].id;
    assert_eq!(std::fs::read_dir(app.data.path().join("frames")).unwrap().count(), 0);
    let gone = app.admin.get(&format!("acquisitions/{id}")).await.ok(200);
    assert_eq!((gone["frame_bytes"].clone(), gone["frames_present"].clone()), (json!(0), json!(3)));
    app.admin.get(&format!("acquisitions/{id}/views/0/frames/0")).await.problem(410, "frames-removed");
    app.admin.put_frame(&id.to_string(), 0, 0, png(0)).await.problem(410, "frames-removed");
    app.admin.get(&format!("inspections/{inspection}/views/0/image.png")).await.problem(410, "frames-removed");
    app.admin.get(&format!("{defect}/card.png")).await.problem(410, "frames-removed");
    let job = json!({ "kind": "inspect", "acquisition_id": id.0, "model_id": model });
    app.admin.post("jobs", job).await.problem(410, "frames-removed");
    app.admin.get(&format!("inspections/{inspection}/lay-lengths")).await.ok(200);
    assert_eq!(app.admin.get(&format!("inspections/{inspection}/views/0/likelihood.png")).await.status, 200);
}

#[tokio::test]
async fn what_was_never_inspected_stays_and_so_does_everything_without_a_time() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let id = app.admin.complete_acquisition(&rope).await;
    let store = &app.service.app.store;
    let later = app.service.app.now_ms() + 4000 * DAY_MS;
    assert_eq!(store.overdue(later).await.unwrap(), [], "no time was said");
    keep(&app, &rope, json!(1)).await;
    let overdue = store.overdue(later).await.unwrap();
    let why = Some("it was never inspected with a model");
    assert_eq!((overdue[0].id.to_string(), overdue[0].kept_because.as_deref()), (id, why));
    keep(&app, &rope, json!(null)).await;
    assert_eq!(store.overdue(later).await.unwrap(), []);
}

#[tokio::test]
async fn frames_of_which_only_lay_lengths_are_known_stay_until_a_model_has_looked_for_defects() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let id = app.admin.complete_acquisition(&rope).await;
    keep(&app, &rope, json!(1)).await;
    let store = &app.service.app.store;
    let later = app.service.app.now_ms() + 10 * DAY_MS;
    let overdue = || async { store.overdue(later).await.unwrap().remove(0) };

    app.admin.run(json!({ "kind": "inspect", "acquisition_id": id })).await;
    let kept = overdue().await;
    assert_eq!(kept.kept_because.as_deref(), Some("it was never inspected with a model"));
    assert!(!store.remove_frames(kept.id, later).await.unwrap(), "nobody has looked for defects");
    app.admin.get(&format!("acquisitions/{id}/views/0/frames/0")).await.ok_status(200);

    let model = app.admin.run(json!({ "kind": "train", "acquisition_id": id })).await["result"]["model_id"].clone();
    // Over the peak of the toy's only defect, so that frames are evidence of none.
    let inspect = json!({ "kind": "inspect", "acquisition_id": id, "model_id": model });
    let inspection = app.admin.run(inspect).await["result"]["inspection_id"].as_str().unwrap().to_owned();
    let higher = json!({ "line_score": 9.5, "reason": "test" });
    app.admin.post(&format!("inspections/{inspection}/thresholds"), higher).await.ok(201);
    assert_eq!(overdue().await.kept_because, None);
    assert!(store.remove_frames(kept.id, later).await.unwrap());
}
