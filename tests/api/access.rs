//! Who may do what, for every route of the contract.

use crate::app::{Caller, TestApp};
use ropescope::store::tokens::Role;
use serde_json::{Value, json};

const METHODS: [&str; 5] = ["get", "put", "post", "patch", "delete"];

/// Every (method, path) of the contract, with a value in every place, and whether it is open to all.
async fn routes(app: &TestApp) -> Vec<(String, String, bool)> {
    let contract = app.admin.get("/openapi.json").await.ok(200);
    let mut routes = Vec::new();
    for (path, item) in contract["paths"].as_object().unwrap() {
        for method in METHODS {
            let operation: &Value = &item[method];
            if operation.is_object() {
                let open = operation["security"] == json!([{}]);
                let filled = path
                    .replace("{id}", "00000000-0000-4000-8000-000000000000")
                    .replace("{view}", "0")
                    .replace("{frame}", "0")
                    .replace("{version}", "1");
                assert!(!filled.contains('{'), "{filled}");
                routes.push((method.to_uppercase(), filled, open));
            }
        }
    }
    assert!(routes.len() > 45, "{}", routes.len());
    routes
}

/// Roles that may use a route, said once more in other words than the router's.
fn allowed(role: Role, method: &str, path: &str) -> bool {
    let path = path.trim_start_matches("/api/v1/");
    let resource = path.split('/').next().unwrap();
    let read = method == "GET";
    match role {
        Role::Admin => true,
        _ if matches!(resource, "tokens" | "webhook-endpoints") => false,
        Role::Operator => true,
        _ if resource == "archives" => role == Role::Upload,
        _ if resource == "deliveries" => false,
        Role::Upload => {
            let frame = path.contains("/frames/");
            match resource {
                "ropes" | "ropeways" => read && !path.contains("history"),
                "acquisitions" => !(read && frame),
                _ => false,
            }
        }
        Role::Ticketing => read || path.ends_with("/ticket"),
        Role::Read => read,
    }
}

#[tokio::test]
async fn without_a_valid_token_every_route_but_health_says_401() {
    let app = TestApp::start().await;
    let token = app.admin.token.clone().unwrap();
    let forged = format!("{}0", &token[..token.len() - 1]);
    let strangers = [None, Some("nonsense".to_owned()), Some(forged), Some("rope__".to_owned())];
    for (method, path, open) in routes(&app).await {
        for token in strangers.iter().filter(|t| **t != app.admin.token) {
            let stranger = Caller { token: token.clone(), ..app.admin.clone() };
            let answer = stranger.send(stranger.request(&method, &path)).await;
            if open {
                assert_eq!(answer.status, 200, "{method} {path}");
            } else {
                answer.problem(401, "unauthorized");
                assert!(answer.header("www-authenticate").starts_with("Bearer"));
            }
        }
    }
}

#[tokio::test]
async fn a_role_may_do_what_it_is_for_and_nothing_else() {
    let app = TestApp::start().await;
    for role in Role::ALL {
        let caller = app.caller(role).await;
        for (method, path, open) in routes(&app).await {
            let answer = caller.send(caller.request(&method, &path)).await;
            let may = open || allowed(role, &method, &path);
            assert_eq!(answer.status != 403, may, "{} {method} {path}: {}", role.name(), answer.status);
            assert_ne!(answer.status, 401);
            assert!(answer.status < 500, "{method} {path}: {}", answer.text());
        }
    }
}

#[tokio::test]
async fn a_token_is_shown_once_and_can_be_revoked() {
    let app = TestApp::start().await;
    let made = app.admin.post("tokens", json!({ "name": "laptop 3", "role": "upload" })).await.ok(201);
    let laptop = Caller { token: Some(made["token"].as_str().unwrap().to_owned()), ..app.admin.clone() };
    laptop.get("ropes").await.ok(200);
    let list = app.admin.get("tokens").await.ok(200);
    let row = list["items"].as_array().unwrap().iter().find(|t| t["id"] == made["id"]).unwrap();
    assert_eq!((&row["token"], &row["revoked_at"]), (&Value::Null, &Value::Null));
    let path = format!("tokens/{}", made["id"].as_str().unwrap());
    assert_eq!(app.admin.send(app.admin.request("DELETE", &path)).await.status, 204);
    laptop.get("ropes").await.problem(401, "unauthorized");
    app.admin.send(app.admin.request("DELETE", "tokens/none")).await.problem(404, "not-found");
    app.admin.post("tokens", json!({ "name": "x", "role": "king" })).await.problem(400, "malformed-body");
}
