//! Receipts and certificates: signed, and never about frames that the disk does not have.

use crate::app::{TestApp, png};
use ropescope::signature;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Duration;

/// Asks for a receipt until there is one, or a problem.
async fn settled(app: &TestApp, id: &str) -> crate::app::Answer {
    for _ in 0..200 {
        let answer = app.admin.post(&format!("acquisitions/{id}/receipt"), json!({})).await;
        if answer.status != 202 {
            return answer;
        }
        assert_eq!(answer.json()["frames"], 3);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("the verification does not end");
}

fn file(app: &TestApp, id: &str, frame: u32) -> PathBuf {
    let folder = app.data.path().join(format!("frames/{id}/0"));
    let mut files = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    files.find(|path| path.to_string_lossy().contains(&format!("/{frame:06}-"))).unwrap()
}

#[tokio::test]
async fn a_receipt_is_signed_by_the_key_that_the_service_names_and_stays_the_same() {
    let app = TestApp::start().await;
    let id = app.admin.complete_acquisition(&app.admin.rope().await).await;
    let receipt = settled(&app, &id).await.ok(200);
    let key = app.admin.get("signing-key").await.ok(200);
    let (document, _) = signature::verify(&receipt, key["x"].as_str()).unwrap();
    assert_eq!((&document["acquisition_id"], &document["frames"]), (&json!(id), &json!(3)));
    assert_eq!(document["bytes"], [0, 1, 2].map(|n| png(n).len()).iter().sum::<usize>());
    let view = &document["views"][0];
    assert_eq!((&view["lines"], &view["from_m"]), (&json!(300), &json!(5.0)));
    assert!((view["to_m"].as_f64().unwrap() - 5.03).abs() < 1e-9);
    assert_eq!(settled(&app, &id).await.ok(200), receipt);
}

#[tokio::test]
async fn an_open_acquisition_gets_no_receipt() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(2)]).await;
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let problem =
        app.admin.post(&format!("acquisitions/{id}/receipt"), json!({})).await.problem(409, "acquisition-incomplete");
    assert_eq!(problem["missing"][0]["missing"], json!([[1, 1]]));
}

#[tokio::test]
async fn a_frame_that_rotted_is_named_and_can_be_sent_again_although_the_acquisition_is_complete() {
    let app = TestApp::start().await;
    let id = app.admin.complete_acquisition(&app.admin.rope().await).await;
    let path = file(&app, &id, 1);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[50] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    std::fs::remove_file(file(&app, &id, 2)).unwrap();
    let problem = settled(&app, &id).await.problem(409, "acquisition-incomplete");
    assert_eq!(problem["missing"][0]["damaged"], json!([1, 2]));
    let missing: Value = app.admin.get(&format!("acquisitions/{id}/missing")).await.ok(200);
    assert_eq!((&missing["complete"], &missing["views"][0]["damaged"]), (&json!(false), &json!([1, 2])));
    app.admin.put_frame(&id, 0, 1, png(7)).await.problem(409, "frame-differs");
    for frame in [1, 2] {
        app.admin.put_frame(&id, 0, frame, png(frame as u8)).await.ok(201);
    }
    assert_eq!(app.admin.get(&format!("acquisitions/{id}/views/0/frames/1")).await.bytes, png(1));
    settled(&app, &id).await.ok(200);
}

#[tokio::test]
async fn a_certificate_tells_metres_that_were_usable_and_why_others_were_not() {
    let app = TestApp::start().await;
    let (_, _, inspection) = app.admin.inspected().await;
    let certificate = app.admin.get(&format!("inspections/{inspection}/coverage-certificate")).await.ok(200);
    let key = app.admin.get("signing-key").await.ok(200);
    let (document, _) = signature::verify(&certificate, key["x"].as_str()).unwrap();
    assert_eq!(document["inspection_id"], json!(inspection));
    let view = &document["views"][0];
    let [seen_m, usable_m] = ["seen_m", "usable_m"].map(|name| view[name].as_f64().unwrap());
    assert!((seen_m - 0.03).abs() < 1e-9 && (usable_m - 0.02).abs() < 1e-9, "{document}");
    assert_eq!(view["not_usable"][0]["reason"], "too dark");
}
