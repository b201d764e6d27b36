//! Manifests: what is announced is not asked for twice, and what has no room is refused before the first byte.

use crate::app::{Answer, Caller, LINES, TestApp, png};
use ropescope::store::tokens::Role;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::time::Duration;

fn entry(view: u32, frame: u32, bytes: &[u8]) -> Value {
    let sha256: String = Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect();
    json!({ "view": view, "frame": frame, "sha256": sha256, "bytes": bytes.len(), "lines": LINES })
}

async fn announce(caller: &Caller, id: &str, entries: Vec<Value>) -> Answer {
    caller.post(&format!("acquisitions/{id}/manifest"), json!({ "frames": entries })).await
}

fn files(app: &TestApp, id: &str) -> usize {
    std::fs::read_dir(app.data.path().join(format!("frames/{id}/0"))).map_or(0, Iterator::count)
}

#[tokio::test]
async fn a_manifest_tells_frames_and_rope_metres_that_are_missing() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(4)]).await;
    let all: Vec<Value> = (0..4).map(|n| entry(0, n, &png(n as u8))).collect();
    app.admin.put_frame(&id, 0, 1, png(1)).await.ok(201);
    let answer = announce(&app.admin, &id, all).await.ok(200);
    assert_eq!(answer["to_send"], json!([{"view": 0, "frame": 0}, {"view": 0, "frame": 2}, {"view": 0, "frame": 3}]));
    let bytes: usize = [0, 2, 3].map(|n| png(n).len()).iter().sum();
    assert_eq!(answer["missing_bytes"], bytes);
    let missing = app.admin.get(&format!("acquisitions/{id}/missing")).await.ok(200);
    assert_eq!(missing["views"][0]["missing"], json!([[0, 0], [2, 3]]));
    // The acquisition starts at 5 m; a frame has 100 lines of 0.1 mm.
    assert_eq!(missing["views"][0]["missing_m"], json!([[5.0, 5.01], [5.02, 5.04]]));
}

#[tokio::test]
async fn a_frame_that_is_held_elsewhere_is_not_sent_again() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let held = app.admin.complete_acquisition(&rope).await;
    let id = app.admin.acquisition(&rope, &[Some(3)]).await;
    let entries = vec![entry(0, 0, &png(1)), entry(0, 1, &png(2)), entry(0, 2, &png(77))];
    let answer = announce(&app.admin, &id, entries.clone()).await.ok(200);
    assert_eq!(answer["to_send"], json!([{"view": 0, "frame": 2}]));
    assert_eq!(app.admin.get(&format!("acquisitions/{id}/views/0/frames/1")).await.bytes, png(2));
    assert_eq!(std::fs::read_dir(app.data.path().join("uploads")).unwrap().count(), 0);
    // It stays when the other acquisition goes.
    app.admin.send(app.admin.request("DELETE", &format!("acquisitions/{held}"))).await;
    assert_eq!(app.admin.get(&format!("acquisitions/{id}/views/0/frames/0")).await.bytes, png(1));
    app.admin.put_frame(&id, 0, 2, png(77)).await.ok(201);
    assert_eq!(announce(&app.admin, &id, entries).await.ok(200)["to_send"], json!([]));
    app.admin.post(&format!("acquisitions/{id}/completion"), json!({})).await.ok(200);
}

#[tokio::test]
async fn a_twin_that_rotted_on_the_disk_is_not_taken_over() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let held = app.admin.complete_acquisition(&rope).await;
    let folder = app.data.path().join(format!("frames/{held}/0"));
    let file = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.to_string_lossy().contains("/000001-"));
    std::fs::write(file.unwrap(), b"rot").unwrap();
    let id = app.admin.acquisition(&rope, &[Some(1)]).await;
    let answer = announce(&app.admin, &id, vec![entry(0, 0, &png(1))]).await.ok(200);
    assert_eq!(answer["to_send"], json!([{"view": 0, "frame": 0}]));
    assert_eq!((files(&app, &id), std::fs::read_dir(app.data.path().join("uploads")).unwrap().count()), (0, 0));
}

#[tokio::test]
async fn what_arrives_must_be_what_was_announced() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(3)]).await;
    let short = png(0);
    announce(&app.admin, &id, vec![entry(0, 0, &short)]).await.ok(200);
    let mut longer = short.clone();
    longer.extend([0; 10]);
    let problem = app.admin.put_frame(&id, 0, 0, longer.clone()).await.problem(413, "body-too-large");
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(longer.len()), &json!(short.len())));
    let mut other = short.clone();
    other[40] ^= 1;
    app.admin.put_frame(&id, 0, 0, other.clone()).await.problem(422, "digest-mismatch");
    assert_eq!(files(&app, &id), 0);
    // Until the bytes are there, the client may change its mind; afterwards not.
    announce(&app.admin, &id, vec![entry(0, 0, &png(5))]).await.ok(200);
    app.admin.put_frame(&id, 0, 0, png(5)).await.ok(201);
    announce(&app.admin, &id, vec![entry(0, 0, &short)]).await.problem(409, "frame-differs");
    announce(&app.admin, &id, vec![entry(0, 3, &short)]).await.problem(404, "frame-out-of-range");
    let mut bad = entry(0, 1, &short);
    bad["sha256"] = json!("AB");
    announce(&app.admin, &id, vec![bad]).await.problem(422, "out-of-range");
    announce(&app.admin, &id, vec![]).await.problem(422, "out-of-range");
}

#[tokio::test]
async fn a_manifest_beyond_the_quota_is_refused_with_figures_and_so_is_a_frame() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let ropeway = app.admin.get(&format!("ropes/{rope}")).await.ok(200)["ropeway_id"].as_str().unwrap().to_owned();
    let id = app.admin.acquisition(&rope, &[Some(3)]).await;
    let one = png(0).len();
    let path = format!("ropeways/{ropeway}/storage");
    app.admin.call("PUT", &path, json!([null, null])).await.problem(400, "malformed-body");
    let quota = |bytes: Value| app.admin.call("PUT", &path, json!({ "quota_bytes": bytes }));
    quota(json!(one + 5)).await.ok(200);
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let problem = announce(&app.admin, &id, vec![entry(0, 1, &png(1))]).await.problem(507, "insufficient-storage");
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(png(1).len()), &json!(5)));
    assert_eq!((&problem["used_bytes"], &problem["quota_bytes"]), (&json!(one), &json!(one + 5)));
    let refused = app.admin.put_frame(&id, 0, 1, png(1)).await;
    refused.problem(507, "insufficient-storage");
    assert_eq!(refused.header("retry-after"), "10");
    // A body that does not say how long it is meets the quota when it has arrived.
    let body = futures::stream::iter([Ok::<_, std::io::Error>(png(1))]);
    let request = app.admin.request("PUT", &format!("acquisitions/{id}/views/0/frames/1"));
    let refused = app.admin.send(request.body(reqwest::Body::wrap_stream(body))).await;
    refused.problem(507, "insufficient-storage");
    quota(json!(null)).await.ok(200);
    app.admin.put_frame(&id, 0, 1, png(1)).await.ok(201);
    app.admin
        .call("PUT", &format!("ropeways/{ropeway}/storage"), json!({ "quota_bytes": 2_000_000_000_000_000_u64 }))
        .await
        .problem(422, "out-of-range");
}

#[tokio::test]
async fn head_room_of_the_disk_is_not_touched_by_uploads() {
    let app = TestApp::start_with(|s| s.limits.reserve_bytes = 1 << 60).await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(3)]).await;
    for answer in
        [announce(&app.admin, &id, vec![entry(0, 0, &png(0))]).await, app.admin.put_frame(&id, 0, 0, png(0)).await]
    {
        let problem = answer.problem(507, "insufficient-storage");
        assert_eq!((&problem["limit"], &problem["reserve_bytes"]), (&json!(0), &json!(1_u64 << 60)));
        assert!(problem["free_bytes"].as_u64().unwrap() > 0);
    }
    assert_eq!(files(&app, &id), 0);
}

/// A frame whose body begins and then hangs.
fn hanging(caller: &Caller, path: &str) -> (tokio::task::JoinHandle<Answer>, tokio::sync::mpsc::Sender<Vec<u8>>) {
    let (sender, receiver) = tokio::sync::mpsc::channel::<Vec<u8>>(4);
    let pieces =
        futures::stream::unfold(receiver, async |mut r| r.recv().await.map(|b| (Ok::<_, std::io::Error>(b), r)));
    let request = caller.request("PUT", path).body(reqwest::Body::wrap_stream(pieces));
    let caller = caller.clone();
    (tokio::spawn(async move { caller.send(request).await }), sender)
}

#[tokio::test]
async fn a_frame_that_hangs_is_given_up_when_the_client_sends_it_again() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(1)]).await;
    let (stale, sender) = hanging(&app.admin, &format!("acquisitions/{id}/views/0/frames/0"));
    sender.send(png(0)[..100].to_vec()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(1300)).await;
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let stale = tokio::time::timeout(Duration::from_secs(5), stale).await.expect("it was ended").unwrap();
    stale.problem(409, "superseded");
}

#[tokio::test]
async fn a_frame_that_was_given_up_leaves_nothing_while_its_client_may_still_send() {
    let app = TestApp::start_with(|s| s.limits.body_gap = Duration::from_millis(300)).await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(1)]).await;
    let (stale, sender) = hanging(&app.admin, &format!("acquisitions/{id}/views/0/frames/0"));
    sender.send(png(0)[..100].to_vec()).await.unwrap();
    let uploads = app.data.path().join("uploads");
    let half_done = || std::fs::read_dir(&uploads).unwrap().count();
    let within = std::time::Instant::now() + Duration::from_secs(5);
    while half_done() == 0 && std::time::Instant::now() < within {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    assert_eq!(half_done(), 1, "it was begun");
    tokio::time::sleep(Duration::from_millis(1300)).await;
    assert_eq!(half_done(), 0, "given up");
    assert!(!stale.is_finished(), "its client might still send");
    // The client gives it up, too: nobody waits for the old request any more.
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    let stale = tokio::time::timeout(Duration::from_secs(5), stale).await.expect("it was ended").unwrap();
    stale.problem(408, "too-slow");
}

#[tokio::test]
async fn a_token_revoked_while_its_frame_arrives_stores_nothing() {
    let app = TestApp::start().await;
    let id = app.admin.acquisition(&app.admin.rope().await, &[Some(1)]).await;
    let laptop = app.caller(Role::Upload).await;
    let (request, sender) = hanging(&laptop, &format!("acquisitions/{id}/views/0/frames/0"));
    sender.send(png(0)[..100].to_vec()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(200)).await;
    let token = laptop.token.unwrap().split('_').nth(1).unwrap().to_owned();
    app.admin.send(app.admin.request("DELETE", &format!("tokens/{token}"))).await.ok(204);
    sender.send(png(0)[100..].to_vec()).await.unwrap();
    drop(sender);
    request.await.unwrap().problem(401, "unauthorized");
    assert_eq!(files(&app, &id), 0);
}
