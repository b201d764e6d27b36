//! Ropeways, ropes, pages, and what every route has in common.

use crate::app::{TestApp, design, new_id, rope};
use serde_json::json;

#[tokio::test]
async fn a_repeated_create_is_the_same_create_and_another_content_is_refused() {
    let app = TestApp::start().await;
    let id = new_id();
    let path = format!("ropeways/{id}");
    let first = app.admin.call("PUT", &path, json!({ "name": "North", "location": "valley" })).await;
    assert_eq!(first.header("location"), format!("/api/v1/ropeways/{id}"));
    let first = first.ok(201);
    assert_eq!(app.admin.call("PUT", &path, json!({ "name": "North", "location": "valley" })).await.ok(200), first);
    app.admin.call("PUT", &path, json!({ "name": "South" })).await.problem(409, "id-in-use");
    assert_eq!(app.admin.get(&path).await.ok(200), first);
    app.admin.call("PUT", &path, json!({ "name": "North", "id": new_id() })).await.problem(422, "out-of-range");
}

#[tokio::test]
async fn pages_follow_each_other_without_gap_or_repeat() {
    let app = TestApp::start().await;
    for n in 0..5 {
        app.admin.post("ropeways", json!({ "name": format!("{n}") })).await.ok(201);
    }
    let mut names = Vec::new();
    let mut path = "ropeways?limit=2".to_owned();
    loop {
        let page = app.admin.get(&path).await.ok(200);
        names.extend(page["items"].as_array().unwrap().iter().map(|i| i["name"].as_str().unwrap().to_owned()));
        let Some(cursor) = page["next_cursor"].as_str() else { break };
        path = format!("ropeways?limit=2&cursor={cursor}");
    }
    assert_eq!(names, ["4", "3", "2", "1", "0"]);
    let problem = app.admin.get("ropeways?limit=201").await.problem(422, "out-of-range");
    assert_eq!((&problem["value"], &problem["limit"]["max"]), (&json!(201.0), &json!(200.0)));
    app.admin.get("ropeways?cursor=nonsense").await.problem(422, "out-of-range");
}

#[tokio::test]
async fn a_design_that_is_no_rope_is_refused_with_all_its_violations() {
    let app = TestApp::start().await;
    let ropeway = app.admin.ropeway().await;
    let mut body = rope(&ropeway);
    body["design"]["wire_diameter_mm"] = json!(4.0);
    body["design"]["strand_lay_mm"] = json!(10.0);
    let problem = app.admin.post("ropes", body).await.problem(422, "design-impossible");
    let violations = problem["violations"].as_array().unwrap();
    assert_eq!(violations.len(), 2, "{problem}");
    assert!(violations.iter().any(|v| v["quantity"] == "wire_diameter_mm" && v["limit"]["max"].is_number()));
    let mut body = rope(&ropeway);
    body["design"].as_object_mut().unwrap().remove("strands");
    let problem = app.admin.post("ropes", body).await.problem(400, "malformed-body");
    assert!(problem["detail"].as_str().unwrap().contains("missing field `strands`"), "{problem}");
    assert!(app.admin.get("ropes").await.ok(200)["items"].as_array().unwrap().is_empty());
}

#[tokio::test]
async fn a_rope_of_an_unknown_ropeway_is_refused() {
    let app = TestApp::start().await;
    app.admin.post("ropes", rope(&new_id())).await.problem(422, "unknown-reference");
}

#[tokio::test]
async fn ropes_are_listed_by_ropeway_and_their_ticket_level_can_be_set_and_cleared() {
    let app = TestApp::start().await;
    let id = app.admin.rope().await;
    let rope = app.admin.get(&format!("ropes/{id}")).await.ok(200);
    assert_eq!(rope["design"]["strand_lay_mm"], design()["strand_lay_mm"]);
    let ropeway = rope["ropeway_id"].as_str().unwrap();
    assert_eq!(app.admin.get(&format!("ropes?ropeway_id={ropeway}")).await.ok(200)["items"][0], rope);
    assert_eq!(app.admin.get(&format!("ropes?ropeway_id={}", new_id())).await.ok(200)["items"], json!([]));
    let path = format!("ropes/{id}/ticketing");
    assert_eq!(app.admin.call("PATCH", &path, json!({ "ticket_level": 7.5 })).await.ok(200)["ticket_level"], 7.5);
    assert!(app.admin.call("PATCH", &path, json!({ "ticket_level": null })).await.ok(200)["ticket_level"].is_null());
    app.admin.call("PATCH", &path, json!({})).await.problem(400, "malformed-body");
}

#[tokio::test]
async fn whatever_goes_wrong_is_a_problem() {
    let app = TestApp::start().await;
    let admin = &app.admin;
    admin.get("/nowhere").await.problem(404, "not-found");
    admin.get("ropes/not-a-uuid").await.problem(400, "malformed-path");
    admin.get(&format!("ropes/{}", new_id())).await.problem(404, "not-found");
    admin.get("ropes?limit=x").await.problem(400, "malformed-query");
    let answer = admin.send(admin.request("DELETE", "ropeways")).await;
    answer.problem(405, "method-not-allowed");
    assert!(answer.header("allow").contains("POST"));
    admin.send(admin.request("POST", "ropeways").body("{}")).await.problem(415, "unsupported-media-type");
    let json =
        |body: &str| admin.request("POST", "ropeways").header("content-type", "application/json").body(body.to_owned());
    admin.send(json("{")).await.problem(400, "malformed-body");
    admin.send(json(r#"{"name":"x","colour":"red"}"#)).await.problem(400, "malformed-body");
    admin.send(json(r#"{"name":""}"#)).await.problem(422, "out-of-range");
    admin.send(json(&format!(r#"{{"name":"{}"}}"#, "x".repeat(300 << 10)))).await.problem(413, "body-too-large");
    assert!(!admin.get("/nowhere").await.header("x-request-id").is_empty());
}

#[tokio::test]
async fn health_needs_no_token_and_metrics_do() {
    let app = TestApp::start().await;
    let nobody = crate::app::Caller { token: None, ..app.admin.clone() };
    assert_eq!(nobody.get("/healthz").await.ok(200)["status"], "ok");
    nobody.get("/readyz").await.ok(200);
    nobody.get("/metrics").await.problem(401, "unauthorized");
    let metrics = app.admin.get("/metrics").await;
    assert!(metrics.text().contains("ropescope_http_requests_total"));
    assert_eq!(nobody.get("/docs/").await.status, 200);
    assert_eq!(nobody.get("/openapi.json").await.ok(200)["info"]["title"], "Ropescope");
}
