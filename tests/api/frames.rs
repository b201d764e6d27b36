//! Frames: every bad one is refused with its own problem and changes nothing.

use crate::app::{LINES, SENSOR_PX, TestApp, new_id, png, png_of};
use base64::Engine;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

fn digest(bytes: &[u8]) -> String {
    format!("sha-256=:{}:", base64::prelude::BASE64_STANDARD.encode(Sha256::digest(bytes)))
}

/// A PNG whose header promises a size and whose pixels never come.
fn header_only(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap();
    bytes
}

struct Open {
    app: TestApp,
    id: String,
}

async fn open() -> Open {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let id = app.admin.acquisition(&rope, &[Some(2)]).await;
    Open { app, id }
}

impl Open {
    /// Nothing is stored: no row, no file, no leftover.
    async fn nothing_changed(&self) {
        let missing = self.app.admin.get(&format!("acquisitions/{}/missing", self.id)).await.ok(200);
        assert_eq!(missing["views"][0]["present"], 0);
        for folder in ["uploads", "frames"] {
            assert_eq!(std::fs::read_dir(self.app.data.path().join(folder)).unwrap().count(), 0, "{folder}");
        }
    }
}

#[tokio::test]
async fn a_frame_is_stored_once_and_comes_back_as_it_was_sent() {
    let Open { app, id } = open().await;
    let bytes = png(1);
    let path = format!("acquisitions/{id}/views/0/frames/1");
    let put = || {
        let request = app.admin.request("PUT", &path).header("content-type", "image/png");
        request.header("repr-digest", digest(&bytes)).body(bytes.clone())
    };
    let first = app.admin.send(put()).await;
    assert_eq!(first.header("repr-digest"), digest(&bytes));
    let frame = first.ok(201);
    assert_eq!((&frame["lines"], &frame["content_type"]), (&json!(LINES), &json!("image/png")));
    assert_eq!(app.admin.send(put()).await.ok(200), frame);
    app.admin.put_frame(&id, 0, 1, png(2)).await.problem(409, "frame-differs");
    let back = app.admin.get(&path).await;
    assert_eq!((back.status, &back.bytes), (200, &bytes));
    let etag = back.header("etag").to_owned();
    let again = app.admin.send(app.admin.request("GET", &path).header("if-none-match", etag)).await;
    assert_eq!((again.status, again.bytes.len()), (304, 0));
    app.admin.get(&format!("acquisitions/{id}/views/0/frames/0")).await.problem(404, "not-found");
}

#[tokio::test]
async fn a_16_bit_tiff_is_a_frame_too() {
    let Open { app, id } = open().await;
    let image = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(SENSOR_PX, LINES, image::Luma([40_000]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Tiff).unwrap();
    let path = format!("acquisitions/{id}/views/0/frames/0");
    let request = app.admin.request("PUT", &path).header("content-type", "image/tiff").body(bytes.into_inner());
    assert_eq!(app.admin.send(request).await.ok(201)["content_type"], "image/tiff");
}

#[tokio::test]
async fn a_frame_of_the_wrong_width_names_both_widths() {
    let open = open().await;
    let problem = open.app.admin.put_frame(&open.id, 0, 0, png_of(100, 10, 0)).await.problem(422, "frame-wrong-width");
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(100), &json!(SENSOR_PX)));
    open.nothing_changed().await;
}

#[tokio::test]
async fn a_truncated_png_is_found_at_once() {
    let open = open().await;
    let bytes = png(0);
    for length in [bytes.len() / 2, bytes.len() - 20, 30, 0] {
        let cut = bytes[..length].to_vec();
        open.app.admin.put_frame(&open.id, 0, 0, cut).await.problem(422, "frame-unreadable");
    }
    open.nothing_changed().await;
}

#[tokio::test]
async fn a_header_of_60000_by_60000_is_refused_before_decoding() {
    let open = open().await;
    let problem =
        open.app.admin.put_frame(&open.id, 0, 0, header_only(60_000, 60_000)).await.problem(422, "frame-too-large");
    assert_eq!(problem["value"], json!({ "columns": 60_000, "lines": 60_000 }));
    assert!(problem["limit"]["pixels"].is_number());
    open.nothing_changed().await;
}

#[tokio::test]
async fn colour_and_other_formats_are_refused() {
    let open = open().await;
    let image = image::RgbImage::new(SENSOR_PX, LINES);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    open.app.admin.put_frame(&open.id, 0, 0, bytes.into_inner()).await.problem(422, "frame-unreadable");
    let path = format!("acquisitions/{}/views/0/frames/0", open.id);
    let request = open.app.admin.request("PUT", &path).header("content-type", "image/jpeg").body(png(0));
    open.app.admin.send(request).await.problem(415, "unsupported-media-type");
    open.nothing_changed().await;
}

#[tokio::test]
async fn a_digest_is_verified_and_a_malformed_one_refused() {
    let open = open().await;
    let admin = &open.app.admin;
    let path = format!("acquisitions/{}/views/0/frames/0", open.id);
    let put = |digest: String| admin.request("PUT", &path).header("repr-digest", digest).body(png(0));
    let problem = admin.send(put(digest(&png(1)))).await.problem(422, "digest-mismatch");
    assert_ne!(problem["value"], problem["limit"]);
    admin.send(put("sha-256=abc".into())).await.problem(400, "malformed-header");
    open.nothing_changed().await;
    admin.send(put(format!("md5=:AAAA:, {}", digest(&png(0))))).await.ok(201);
}

#[tokio::test]
async fn views_and_frames_out_of_range_are_named() {
    let Open { app, id } = open().await;
    let problem = app.admin.put_frame(&id, 4, 0, png(0)).await.problem(404, "view-out-of-range");
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(4), &json!(0)));
    let problem = app.admin.put_frame(&id, 0, 2, png(0)).await.problem(404, "frame-out-of-range");
    assert_eq!((&problem["value"], &problem["limit"]), (&json!(2), &json!(1)));
    app.admin.put_frame(&new_id(), 0, 0, png(0)).await.problem(404, "not-found");
    let unannounced = app.admin.acquisition(&app.admin.rope().await, &[None]).await;
    app.admin.put_frame(&unannounced, 0, 1_000_000, png(0)).await.problem(404, "frame-out-of-range");
}

#[tokio::test]
async fn an_oversized_body_is_refused_whether_it_says_so_or_not() {
    let app = TestApp::start_with(|s| s.limits.frame_bytes = 100_000).await;
    let rope = app.admin.rope().await;
    let id = app.admin.acquisition(&rope, &[Some(2)]).await;
    let problem = app.admin.put_frame(&id, 0, 0, vec![0; 150_000]).await.problem(413, "body-too-large");
    assert_eq!(problem["limit"], 100_000);
    let chunks = futures::stream::iter((0..15).map(|_| Ok::<_, std::io::Error>(vec![0_u8; 10_000])));
    let path = format!("acquisitions/{id}/views/0/frames/0");
    let request = app.admin.request("PUT", &path).body(reqwest::Body::wrap_stream(chunks));
    app.admin.send(request).await.problem(413, "body-too-large");
    (Open { app, id }).nothing_changed().await;
}

#[tokio::test]
async fn a_complete_acquisition_takes_no_frame_but_still_knows_its_own() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let id = app.admin.acquisition(&rope, &[None]).await;
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(201);
    app.admin.post(&format!("acquisitions/{id}/completion"), json!({ "views": [{ "frames": 1 }] })).await.ok(200);
    app.admin.put_frame(&id, 0, 0, png(0)).await.ok(200);
    app.admin.put_frame(&id, 0, 0, png(1)).await.problem(409, "frame-differs");
    app.admin.put_frame(&id, 0, 1, png(1)).await.problem(404, "frame-out-of-range");
}

#[tokio::test]
async fn of_many_who_send_one_frame_number_at_once_one_content_wins() {
    let Open { app, id } = open().await;
    let sends = (0..12_u8).map(|n| {
        let (admin, id) = (app.admin.clone(), id.clone());
        tokio::spawn(async move { (n % 2, admin.put_frame(&id, 0, 0, png(n % 2)).await) })
    });
    let answers: Vec<(u8, u16)> = futures::future::join_all(sends)
        .await
        .into_iter()
        .map(|done| done.map(|(seed, answer)| (seed, answer.status)).unwrap())
        .collect();
    let winner = answers.iter().find(|(_, status)| *status == 201).expect("one is new").0;
    assert_eq!(answers.iter().filter(|(_, status)| *status == 201).count(), 1, "{answers:?}");
    for (seed, status) in answers {
        assert!(if seed == winner { [200, 201].contains(&status) } else { status == 409 });
    }
    let back = app.admin.get(&format!("acquisitions/{id}/views/0/frames/0")).await;
    assert_eq!(back.bytes, png(winner));
    assert_eq!(std::fs::read_dir(app.data.path().join(format!("frames/{id}/0"))).unwrap().count(), 1);
    let _: Value = app.admin.get(&format!("acquisitions/{id}")).await.ok(200);
}
