//! `openapi.yaml` and the router are the same contract.

use crate::app::TestApp;

#[tokio::test]
async fn the_committed_contract_is_the_one_that_is_served() {
    let app = TestApp::start().await;
    let served = app.admin.get("/openapi.yaml").await.text();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi.yaml");
    if std::env::var_os("REGENERATE").is_some() {
        std::fs::write(path, &served).unwrap();
    }
    let committed = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        committed == served,
        "openapi.yaml is not what the router serves: REGENERATE=1 cargo test --test api contract"
    );
}

#[tokio::test]
async fn every_operation_has_an_id_a_tag_and_its_parameters_where_they_belong() {
    let app = TestApp::start().await;
    let contract = app.admin.get("/openapi.json").await.ok(200);
    for (path, item) in contract["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap().iter().filter(|(_, o)| o["responses"].is_object()) {
            assert!(operation["operationId"].is_string() && operation["tags"][0].is_string(), "{method} {path}");
            for parameter in operation["parameters"].as_array().into_iter().flatten() {
                let name = parameter["name"].as_str().unwrap();
                assert_eq!(parameter["in"] == "path", path.contains(&format!("{{{name}}}")), "{method} {path} {name}");
            }
        }
    }
}
