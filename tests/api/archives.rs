//! Recordings that come as one file over tus: kept as far as they arrived, and taken only when they are honest.

use crate::app::{Answer, Caller, SENSOR_PX, TestApp, design, png, png_of};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use ropescope::store::tokens::Role;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::io::Write;
use std::time::Duration;

type Files = Vec<(String, Vec<u8>)>;

fn rope_json() -> Vec<u8> {
    let mut file = design();
    file["line_pitch_mm"] = json!(0.1);
    file["sensor_px"] = json!(SENSOR_PX);
    file["views"] = json!([{ "folder": "view0", "angle_deg": 0.0 }]);
    file.to_string().into_bytes()
}

/// An honest recording of three frames, in a folder of its own as `tar czf rope` makes it.
fn honest() -> Files {
    let mut files = vec![("rope/notes.txt".to_owned(), b"sunny".to_vec())];
    files.extend((0..3).map(|n| (format!("rope/view0/frame_{n:06}.png"), png(n as u8))));
    files.push(("rope/rope.json".to_owned(), rope_json()));
    files
}

fn tar(files: &Files) -> Vec<u8> {
    let mut builder = tar::Builder::new(Vec::new());
    for (name, content) in files {
        let mut header = tar::Header::new_gnu();
        header.as_gnu_mut().unwrap().name[..name.len()].copy_from_slice(name.as_bytes()); // also names that no builder takes
        header.set_size(content.len() as u64);
        header.set_mode(0o644);
        header.set_cksum();
        builder.append(&header, &content[..]).unwrap();
    }
    builder.into_inner().unwrap()
}

fn zip(files: &Files) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (name, content) in files {
        writer.start_file(name.as_str(), options).unwrap();
        writer.write_all(content).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

async fn begin(caller: &Caller, rope: &str, length: usize) -> Answer {
    let metadata = format!("filename {},rope_id {}", BASE64_STANDARD.encode("rope.tar"), BASE64_STANDARD.encode(rope));
    let request = caller.request("POST", "tus").header("tus-resumable", "1.0.0");
    caller.send(request.header("upload-length", length).header("upload-metadata", metadata)).await
}

fn chunk(caller: &Caller, place: &str, offset: usize, bytes: &[u8]) -> reqwest::RequestBuilder {
    let request = caller.request("PATCH", place).header("tus-resumable", "1.0.0").header("upload-offset", offset);
    request.header("content-type", "application/offset+octet-stream").body(bytes.to_vec())
}

async fn head(caller: &Caller, place: &str) -> Answer {
    caller.send(caller.request("HEAD", place).header("tus-resumable", "1.0.0")).await
}

/// Waits until an archive that arrived whole is unpacked or refused.
async fn settled(caller: &Caller, place: &str) -> Value {
    for _ in 0..400 {
        let archive = caller.get(&place.replace("/tus/", "/archives/")).await.ok(200);
        if archive["state"] != "unpacking" {
            return archive;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("{place} is not settled");
}

/// Sends a file in one piece and waits for what becomes of it.
async fn send(caller: &Caller, rope: &str, bytes: &[u8]) -> Value {
    let begun = begin(caller, rope, bytes.len()).await;
    begun.ok_status(201);
    let place = begun.header("location").to_owned();
    caller.send(chunk(caller, &place, 0, bytes)).await.ok_status(204);
    settled(caller, &place).await
}

#[tokio::test]
async fn tar_and_zip_become_complete_acquisitions_with_the_same_frames() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    for bytes in [tar(&honest()), zip(&honest())] {
        let archive = send(&app.admin, &rope, &bytes).await;
        assert_eq!(archive["state"], "unpacked", "{archive}");
        let id = archive["acquisition_id"].as_str().unwrap();
        assert_eq!(app.admin.get(&format!("acquisitions/{id}")).await.ok(200)["state"], "complete");
        for n in 0..3 {
            assert_eq!(app.admin.get(&format!("acquisitions/{id}/views/0/frames/{n}")).await.bytes, png(n));
        }
        assert_eq!(std::fs::read_dir(app.data.path().join("archives")).unwrap().count(), 0);
    }
}

#[tokio::test]
async fn a_chunk_that_does_not_continue_the_file_is_refused_and_the_offset_tells_where_to_go_on() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let bytes = tar(&honest());
    let begun = begin(&app.admin, &rope, bytes.len()).await;
    let place = begun.header("location").to_owned();
    assert!(begun.header("upload-expires").ends_with("GMT"), "{:?}", begun.headers);
    app.admin.send(chunk(&app.admin, &place, 0, &bytes[..1000])).await.ok_status(204);
    app.admin.send(chunk(&app.admin, &place, 0, &bytes[..1000])).await.problem(409, "wrong-offset");
    app.admin.send(chunk(&app.admin, &place, 2000, &bytes[2000..])).await.problem(409, "wrong-offset");
    let mut longer = bytes[1000..].to_vec();
    longer.push(0);
    app.admin.send(chunk(&app.admin, &place, 1000, &longer)).await.problem(413, "body-too-large");
    let told = head(&app.admin, &place).await;
    assert_eq!((told.header("upload-offset"), told.header("cache-control")), ("1000", "no-store"));
    assert_eq!(told.header("upload-length"), bytes.len().to_string());
    app.admin.send(chunk(&app.admin, &place, 1000, &bytes[1000..])).await.ok_status(204);
    assert_eq!(settled(&app.admin, &place).await["state"], "unpacked");
}

#[tokio::test]
async fn a_chunk_with_a_wrong_checksum_leaves_no_byte() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let bytes = tar(&honest());
    let place = begin(&app.admin, &rope, bytes.len()).await.header("location").to_owned();
    let sum = |of: &[u8]| format!("sha256 {}", BASE64_STANDARD.encode(Sha256::digest(of)));
    let wrong = chunk(&app.admin, &place, 0, &bytes).header("upload-checksum", sum(b"other"));
    app.admin.send(wrong).await.problem(460, "checksum-mismatch");
    let unknown = chunk(&app.admin, &place, 0, &bytes).header("upload-checksum", "md5 AAAA");
    app.admin.send(unknown).await.problem(400, "malformed-header");
    assert_eq!(head(&app.admin, &place).await.header("upload-offset"), "0");
    let right = chunk(&app.admin, &place, 0, &bytes).header("upload-checksum", sum(&bytes));
    app.admin.send(right).await.ok_status(204);
    assert_eq!(settled(&app.admin, &place).await["state"], "unpacked");
}

#[tokio::test]
async fn what_arrived_of_a_request_that_hangs_counts_and_asking_for_the_offset_ends_it() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let bytes = tar(&honest());
    let place = begin(&app.admin, &rope, bytes.len()).await.header("location").to_owned();
    let (sender, receiver) = tokio::sync::mpsc::channel::<Vec<u8>>(4);
    let pieces =
        futures::stream::unfold(receiver, async |mut r| r.recv().await.map(|b| (Ok::<_, std::io::Error>(b), r)));
    let hanging = chunk(&app.admin, &place, 0, &[]).body(reqwest::Body::wrap_stream(pieces));
    let admin = app.admin.clone();
    let hanging = tokio::spawn(async move { admin.send(hanging).await });
    sender.send(bytes[..5000].to_vec()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let told = tokio::time::timeout(Duration::from_secs(5), head(&app.admin, &place)).await.expect("it does not wait");
    assert_eq!(told.header("upload-offset"), "5000");
    tokio::time::timeout(Duration::from_secs(5), hanging)
        .await
        .expect("it was ended")
        .unwrap()
        .problem(409, "superseded");
    app.admin.send(chunk(&app.admin, &place, 5000, &bytes[5000..])).await.ok_status(204);
    assert_eq!(settled(&app.admin, &place).await["state"], "unpacked");
}

#[tokio::test]
async fn a_file_beyond_the_quota_is_refused_with_figures_before_its_first_byte() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let ropeway = app.admin.get(&format!("ropes/{rope}")).await.ok(200)["ropeway_id"].as_str().unwrap().to_owned();
    app.admin.call("PUT", &format!("ropeways/{ropeway}/storage"), json!({ "quota_bytes": 5000 })).await.ok(200);
    let problem = begin(&app.admin, &rope, 5001).await.problem(507, "insufficient-storage");
    assert_eq!(
        (&problem["value"], &problem["limit"], &problem["quota_bytes"]),
        (&json!(5001), &json!(5000), &json!(5000))
    );
    begin(&app.admin, &rope, 5000).await.ok_status(201);
}

#[tokio::test]
async fn a_file_whose_token_is_revoked_while_it_arrives_is_not_unpacked() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let laptop = app.caller(Role::Upload).await;
    let bytes = tar(&honest());
    let place = begin(&laptop, &rope, bytes.len()).await.header("location").to_owned();
    let (sender, receiver) = tokio::sync::mpsc::channel::<Vec<u8>>(4);
    let pieces =
        futures::stream::unfold(receiver, async |mut r| r.recv().await.map(|b| (Ok::<_, std::io::Error>(b), r)));
    let sending = chunk(&laptop, &place, 0, &[]).body(reqwest::Body::wrap_stream(pieces));
    let caller = laptop.clone();
    let sending = tokio::spawn(async move { caller.send(sending).await });
    sender.send(bytes[..5000].to_vec()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(200)).await;
    let token = laptop.token.unwrap().split('_').nth(1).unwrap().to_owned();
    app.admin.send(app.admin.request("DELETE", &format!("tokens/{token}"))).await.ok(204);
    sender.send(bytes[5000..].to_vec()).await.unwrap();
    drop(sender);
    sending.await.unwrap().problem(401, "unauthorized");
    let archive = app.admin.get(&place.replace("/tus/", "/archives/")).await.ok(200);
    assert_eq!((&archive["state"], &archive["received"]), (&json!("receiving"), &json!(0)));
    assert_eq!(app.admin.get("acquisitions").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn hostile_archives_are_refused_and_nothing_is_stored() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let with = |name: &str, content: Vec<u8>| {
        let mut files = honest();
        files.insert(0, (name.to_owned(), content));
        files
    };
    let mut link = tar::Builder::new(Vec::new());
    let mut header = tar::Header::new_gnu();
    header.set_entry_type(tar::EntryType::Symlink);
    header.set_size(0);
    link.append_link(&mut header, "rope/view0", "/etc").unwrap();
    let mut gap = honest();
    gap.remove(2);
    let mut broken = honest();
    broken[3].1.truncate(60);
    let mut wide = honest();
    wide[2].1 = png_of(100, 10, 0);
    let bomb = with("rope/view0/frame_000003.png", vec![0; 70 << 20]);
    let cut = zip(&honest());
    for (what, bytes, said) in [
        ("a name with ..", tar(&with("../evil.png", png(0))), "outside the archive"),
        ("an absolute name", tar(&with("/etc/evil", png(0))), "outside the archive"),
        ("a zip name with ..", zip(&with("rope/../../evil.png", png(0))), "outside the archive"),
        ("a backslash", zip(&with("..\\evil.png", png(0))), "outside the archive"),
        ("a link", link.into_inner().unwrap(), "a link or a device"),
        ("a bomb", zip(&bomb), "may be at most"),
        ("a gap", tar(&gap), "some are missing"),
        ("a broken frame", tar(&broken), "not a whole"),
        ("a frame of another width", tar(&wide), "100 columns"),
        ("no rope.json", tar(&honest()[..4].to_vec()), "no rope.json"),
        ("a zip that is cut", cut[..cut.len() / 2].to_vec(), "no whole tar or zip"),
        ("no archive", vec![7; 5000], "no whole tar or zip"),
    ] {
        let archive = send(&app.admin, &rope, &bytes).await;
        assert_eq!(archive["state"], "refused", "{what}: {archive}");
        assert!(archive["problem"]["detail"].as_str().unwrap().contains(said), "{what}: {archive}");
        for folder in ["frames", "uploads", "archives"] {
            let left = || std::fs::read_dir(app.data.path().join(folder)).unwrap().count();
            // The file goes after the answer is recorded.
            for _ in 0..500 {
                if left() == 0 {
                    break;
                }
                tokio::time::sleep(std::time::Duration::from_millis(10)).await;
            }
            assert_eq!(left(), 0, "{what}: {folder}");
        }
    }
    assert_eq!(app.admin.get("acquisitions").await.ok(200)["items"], json!([]));
}

#[tokio::test]
async fn an_upload_belongs_to_its_token_expires_and_can_be_terminated() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let (laptop, stranger) = (app.caller(Role::Upload).await, app.caller(Role::Upload).await);
    let place = begin(&laptop, &rope, 100).await.header("location").to_owned();
    assert_eq!(head(&stranger, &place).await.status, 404);
    stranger.send(chunk(&stranger, &place, 0, b"x")).await.problem(404, "not-found");
    stranger.get(&place.replace("/tus/", "/archives/")).await.problem(404, "not-found");
    let reader = app.caller(Role::Read).await;
    begin(&reader, &rope, 100).await.problem(403, "forbidden");
    let nobody = Caller { token: None, ..laptop.clone() };
    begin(&nobody, &rope, 100).await.problem(401, "unauthorized");
    begin(&laptop, "nonsense", 100).await.problem(422, "unknown-reference");
    begin(&laptop, &rope, 0).await.problem(413, "body-too-large");
    let other_version = laptop.request("HEAD", &place).header("tus-resumable", "0.2.2");
    let answer = laptop.send(other_version).await;
    assert_eq!((answer.status, answer.header("tus-version")), (412, "1.0.0"));
    let store = &app.service.app.store;
    let id = place.rsplit('/').next().unwrap().parse::<uuid::Uuid>().unwrap();
    store.archive_received(ropescope::store::Id(id), 0, 1).await.unwrap(); // its time was over in 1970
    laptop.send(chunk(&laptop, &place, 0, b"x")).await.problem(410, "upload-expired");
    let place = begin(&laptop, &rope, 100).await.header("location").to_owned();
    assert_eq!(std::fs::read_dir(app.data.path().join("archives")).unwrap().count(), 1, "the expired one is gone");
    let delete = laptop.request("DELETE", &place).header("tus-resumable", "1.0.0");
    laptop.send(delete).await.ok_status(204);
    assert_eq!(head(&laptop, &place).await.status, 404);
}

#[tokio::test]
async fn a_file_whose_time_is_over_goes_although_nobody_begins_another() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let place = begin(&app.admin, &rope, 100).await.header("location").to_owned();
    let id = place.rsplit('/').next().unwrap().parse::<uuid::Uuid>().unwrap();
    app.service.app.store.archive_received(ropescope::store::Id(id), 0, 1).await.unwrap();
    let TestApp { service, data, .. } = app;
    service.stop().await;
    let app = TestApp::start_on(data, |_| {}).await;
    let files = || std::fs::read_dir(app.data.path().join("archives")).unwrap().count();
    for _ in 0..500 {
        if head(&app.admin, &place).await.status == 404 && files() == 0 {
            break; // the row goes first, the file after it
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    assert_eq!(head(&app.admin, &place).await.status, 404);
    assert_eq!(files(), 0);
}

/// Begins a camera dump.
async fn begin_dump(caller: &Caller, rope: &str, rope_json: &[u8], raw_bits: &str, length: usize) -> Answer {
    let pairs = [("rope_id", rope.as_bytes()), ("rope_json", rope_json), ("raw_bits", raw_bits.as_bytes())];
    let metadata: Vec<String> = pairs.iter().map(|(k, v)| format!("{k} {}", BASE64_STANDARD.encode(v))).collect();
    let request = caller.request("POST", "tus").header("tus-resumable", "1.0.0").header("upload-length", length);
    caller.send(request.header("upload-metadata", metadata.join(","))).await
}

#[tokio::test]
async fn a_camera_dump_with_its_geometry_is_cut_into_frames_without_loss() {
    let app = TestApp::start().await;
    let rope = app.admin.rope().await;
    let mut file: Value = serde_json::from_slice(&rope_json()).unwrap();
    file["views"] = json!([{ "folder": "a", "angle_deg": 0.0 }, { "folder": "b", "angle_deg": 90.0 }]);
    let file = file.to_string().into_bytes();
    for (bits, bytes) in [("8", 1), ("16", 2)] {
        // 2,100 lines of each view: a whole frame and a rest.
        let dump: Vec<u8> = (0..2 * 2100 * SENSOR_PX as usize * bytes).map(|i| (i * 7 + i / 911) as u8).collect();
        let begun = begin_dump(&app.admin, &rope, &file, bits, dump.len()).await;
        begun.ok_status(201);
        let place = begun.header("location").to_owned();
        app.admin.send(chunk(&app.admin, &place, 0, &dump)).await.ok_status(204);
        let archive = settled(&app.admin, &place).await;
        assert_eq!(archive["state"], "unpacked", "{archive}");
        let id = archive["acquisition_id"].as_str().unwrap();
        let acquisition = app.admin.get(&format!("acquisitions/{id}")).await.ok(200);
        assert_eq!((&acquisition["state"], &acquisition["frames_present"]), (&json!("complete"), &json!(4)));
        let mut back = Vec::new();
        for (view, frame) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let png = app.admin.get(&format!("acquisitions/{id}/views/{view}/frames/{frame}")).await.bytes;
            let image = image::load_from_memory(&png).unwrap();
            match image {
                image::DynamicImage::ImageLuma8(gray) => back.extend(gray.into_raw()),
                other => back.extend(other.to_luma16().into_raw().iter().flat_map(|g| g.to_le_bytes())),
            }
        }
        assert!(back == dump, "{bits} bit");
    }
    for (json, bits, length, said) in [
        (&file[..], "8", 2 * SENSOR_PX as usize + 1, "whole number of lines"),
        (&file[..], "12", 2 * SENSOR_PX as usize, "must be 8 or 16"),
        (b"{}", "8", 2 * SENSOR_PX as usize, "rope_json in Upload-Metadata is not valid"),
    ] {
        let refused = begin_dump(&app.admin, &rope, json, bits, length).await.problem(422, "archive-refused");
        assert!(refused["detail"].as_str().unwrap().contains(said), "before the first byte is sent: {refused}");
    }
}
