//! A recording as one file, over a service that is killed while it receives and while it unpacks.

use crate::process::{Process, token};
use crate::recording::{assert_stored, get, recording};
use crate::uploader::free_port;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use std::path::Path;
use std::time::{Duration, Instant};

const FRAMES: usize = 40;
const PARTS: usize = 12;

fn tar_of(folder: &Path) -> Vec<u8> {
    let mut builder = tar::Builder::new(Vec::new());
    builder.append_dir_all("rope", folder).unwrap();
    builder.into_inner().unwrap()
}

struct Tus {
    client: reqwest::Client,
    token: String,
}

impl Tus {
    fn request(&self, method: &str, url: &str) -> reqwest::RequestBuilder {
        let request = self.client.request(method.parse().unwrap(), url).bearer_auth(&self.token);
        request.header("tus-resumable", "1.0.0").timeout(Duration::from_secs(20))
    }

    async fn offset(&self, url: &str) -> usize {
        let answer = self.request("HEAD", url).send().await.unwrap();
        answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap()
    }
}

/// Creates what an archive needs: ropeway and rope. Returns the id of the rope.
async fn rope(tus: &Tus, base: &str) -> String {
    let post = async |path: &str, body: serde_json::Value| -> String {
        let request = tus.client.post(format!("{base}/api/v1/{path}")).bearer_auth(&tus.token).json(&body);
        let answer: serde_json::Value = request.send().await.unwrap().json().await.unwrap();
        answer["id"].as_str().unwrap_or_else(|| panic!("{answer}")).to_owned()
    };
    let ropeway = post("ropeways", json!({"name": "North"})).await;
    let design = json!({"strands": 6, "wires_per_strand": 9, "rope_diameter_mm": 32.0, "strand_lay_mm": 220.0, "wire_lay_mm": -95.0});
    post("ropes", json!({"ropeway_id": ropeway, "name": "track rope 1", "design": design})).await
}

#[tokio::test(flavor = "multi_thread")]
async fn an_archive_goes_on_where_the_killed_service_had_it_and_is_unpacked_after_all() {
    ropescope::tls::install();
    let mut rng = ChaCha8Rng::seed_from_u64(17);
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), FRAMES, 200);
    let bytes = tar_of(source.path());
    let token = token(data.path());
    let port = free_port();
    let mut server = Process::serve(data.path(), port, &[]);
    let tus = Tus { client: reqwest::Client::builder().no_proxy().build().unwrap(), token: token.clone() };
    let rope = rope(&tus, &server.base).await;
    let begun = tus
        .request("POST", &format!("{}/api/v1/tus", server.base))
        .header("upload-length", bytes.len())
        .header("upload-metadata", format!("rope_id {}", BASE64_STANDARD.encode(rope)));
    let begun = begun.send().await.unwrap();
    let place = begun.headers()["location"].to_str().unwrap().to_owned();
    let url = format!("{}{place}", server.base);
    let (mut told, mut kills) = (0, 0);
    loop {
        let offset = tus.offset(&url).await;
        assert!(offset >= told, "the service had told {told}, now it has {offset}");
        if offset == bytes.len() {
            break;
        }
        let end = (offset + bytes.len() / PARTS + 1).min(bytes.len());
        let request = tus.request("PATCH", &url).header("upload-offset", offset);
        let request = request.header("content-type", "application/offset+octet-stream");
        let sending = tokio::spawn(request.body(bytes[offset..end].to_vec()).send());
        // The last part is let through, so that the kill falls into the unpacking.
        if kills < 2 * PARTS && end < bytes.len() {
            tokio::time::sleep(Duration::from_millis(rng.random_range(0..12))).await;
            server.kill();
            kills += 1;
            server = Process::serve(data.path(), port, &[]);
        }
        if let Ok(answer) = sending.await.unwrap() {
            assert_eq!(answer.status(), 204);
            told = end;
        }
    }
    assert!(kills >= PARTS - 1, "{kills}");
    for _ in 0..3 {
        tokio::time::sleep(Duration::from_millis(rng.random_range(5..60))).await;
        server.kill();
        server = Process::serve(data.path(), port, &[]);
    }
    let base = server.base.clone();
    let settled = tokio::task::spawn_blocking(move || {
        let begun = Instant::now();
        loop {
            let archive = get(&base, &token, &place.replace("/api/v1/tus/", "archives/"));
            if archive["state"] != "unpacking" {
                return archive;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "{archive}");
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    let archive = settled.await.unwrap();
    assert_eq!(archive["state"], "unpacked", "{archive}");
    assert_stored(data.path(), archive["acquisition_id"].as_str().unwrap(), source.path(), FRAMES);
    assert_eq!(std::fs::read_dir(data.path().join("archives")).unwrap().count(), 0);
}
