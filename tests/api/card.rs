//! The card that says why a defect is one, from a real training and inspection.

use crate::app::new_id;
use crate::process::{Process, token};
use crate::simulated::{caller, simulated, upload};
use ropescope::drawing::heat;
use ropescope::simulate::Recipe;
use serde_json::json;

#[tokio::test(flavor = "multi_thread")]
async fn a_card_shows_a_defect_with_what_intact_rope_would_look_like() {
    let defects = Recipe { defects: 6, defect_free_m: 1.4, ..Recipe::photographic() };
    let folder = simulated(&Recipe { metres: 2.6, view_angles_deg: vec![0.0], ..defects });
    let data = tempfile::tempdir().unwrap();
    let token = token(data.path());
    let process = Process::serve(data.path(), 0, &[]);
    let admin = caller(&process, &token);
    let acquisition = upload(&admin, folder.path()).await;
    // A metre tells little of what two false defects in 100 m score: the largest budget gives the lowest threshold.
    let budget = json!({ "false_defects_per_100m": 100.0 });
    let train = json!({ "kind": "train", "acquisition_id": acquisition, "to_m": 1.4, "budget": budget });
    let model = admin.run(train).await["result"]["model_id"].clone();
    let inspect = json!({ "kind": "inspect", "acquisition_id": acquisition, "model_id": model });
    let inspection = admin.run(inspect).await["result"]["inspection_id"].as_str().unwrap().to_owned();
    let found = admin.get(&format!("inspections/{inspection}/defects")).await.ok(200);
    // So generous a budget also reports places that hardly stand out: the surest of all glows.
    let surest = found["items"].as_array().unwrap().iter().find(|item| item["rank"] == 1).unwrap();
    let defect = surest["defect_id"].as_str().unwrap();

    let path = format!("defects/{defect}/card.png");
    let card = admin.get(&path).await;
    assert_eq!(
        (card.status, card.header("content-type")),
        (200, "image/png"),
        "{}",
        String::from_utf8_lossy(&card.bytes)
    );
    let picture = image::load_from_memory(&card.bytes).unwrap().into_rgb8();
    let dots = |colours: &[[u8; 3]]| picture.pixels().filter(|p| colours.contains(&p.0)).count();
    // What was observed and what was expected are curves of their own, over a band of what is usual.
    for colour in [[225, 85, 25], [0, 130, 150], [190, 220, 224]] {
        assert!(dots(&[colour]) > 1000, "{colour:?}: {}", dots(&[colour]));
    }
    // The defect glows in the likelihood map; most of its neighbourhood does not.
    let glowing: Vec<_> = (0..80).map(heat).collect();
    let likely: Vec<_> = (200..=255).map(heat).collect();
    assert!(dots(&glowing) > 50 && dots(&likely) > 5 * dots(&glowing), "{} {}", dots(&glowing), dots(&likely));

    let tag = card.header("etag").to_owned();
    let again = admin.request("GET", &path).header("if-none-match", &tag);
    assert_eq!(admin.send(again).await.status, 304);
    let verdict = json!({ "verdict": "confirmed", "by": "A. Inspector" });
    admin.post(&format!("defects/{defect}/verdict"), verdict).await.ok(200);
    let judged = admin.send(admin.request("GET", &path).header("if-none-match", &tag)).await;
    assert_eq!(judged.status, 200, "the card names the verdict");
    admin.get(&format!("defects/{}/card.png", new_id())).await.problem(404, "not-found");
}
