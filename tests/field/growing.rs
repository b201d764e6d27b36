//! Recordings that are still being made while they are uploaded.

use crate::process::{PROGRAM, Process, token};
use crate::recording::{assert_stored, get, recording, write_frame};
use crate::uploader::{Uploader, free_port};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const WITHIN: Duration = Duration::from_secs(300);

#[test]
fn a_recording_that_grows_is_sent_as_it_grows_and_completed_when_it_rests() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), 0, 60);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let watching = ["--watch", "--rests-s", "4", "--frame-rests-s", "1"];
    let mut uploader = Uploader::start(source.path(), &server.base, &token, &watching);
    for frame in 0..8 {
        for view in 0..2 {
            write_frame(source.path(), view, frame, 60);
        }
        std::thread::sleep(Duration::from_millis(300));
        if frame == 5 {
            let begun = Instant::now();
            while uploader.held() == 0 {
                assert!(begun.elapsed() < Duration::from_secs(20), "frames are sent while the recording grows");
                std::thread::sleep(Duration::from_millis(50));
            }
            // A laptop that reboots goes on under the same acquisition.
            uploader.kill();
            uploader = Uploader::start(source.path(), &server.base, &token, &watching);
        }
    }
    let report = uploader.report(WITHIN);
    assert_eq!(report["frames"], 16);
    assert_stored(data.path(), report["acquisition_id"].as_str().unwrap(), source.path(), 8);
}

/// A camera that has written its frames `from..to`.
fn record(rope: &Path, growing: &Path, frames: std::ops::Range<usize>) {
    for frame in frames {
        let name = format!("view0/frame_{frame:06}.png");
        std::fs::copy(rope.join(&name), growing.join(&name)).unwrap();
    }
}

#[test]
fn previews_of_a_recording_that_grows_overtake_the_frames_that_wait() {
    const FRAMES: usize = 10;
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (rope, growing) = (source.path().join("rope"), source.path().join("growing"));
    let simulate = ["simulate", "--metres", "2", "--views", "1", "--seed", "5", "--out"];
    assert!(Command::new(PROGRAM).args(simulate).arg(&rope).output().unwrap().status.success());
    std::fs::create_dir_all(growing.join("view0")).unwrap();
    std::fs::copy(rope.join("rope.json"), growing.join("rope.json")).unwrap();
    record(&rope, &growing, 0..4);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    // A link on which a frame takes some seconds, and a round of frames a quarter of a minute.
    let thin = ["--limit-mbit", "2", "--connections", "1"];
    let watching = ["--watch", "--rests-s", "4", "--frame-rests-s", "1", "--preview-first"];
    let mut uploader = Uploader::start(&growing, &server.base, &token, &[&watching[..], &thin].concat());
    let begun = Instant::now();
    let mut until = |what: &str, is: &dyn Fn(&serde_json::Value, &serde_json::Value) -> bool| loop {
        assert!(begun.elapsed() < WITHIN && uploader.running(), "{what}: {:?}", uploader.said().last());
        let items = get(&server.base, &token, "acquisitions")["items"].clone();
        if let Some(id) = items[0]["id"].as_str() {
            let previews = get(&server.base, &token, &format!("acquisitions/{id}/previews"));
            let acquisition = get(&server.base, &token, &format!("acquisitions/{id}"));
            if is(&previews, &acquisition) {
                return acquisition;
            }
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    until("previews of what is there", &|previews, _| previews["views"][0]["present"].as_u64() >= Some(3));
    record(&rope, &growing, 4..FRAMES);
    let seen = until("previews of what came since", &|previews, _| previews["views"][0]["present"] == FRAMES);
    assert!(seen["frames_present"].as_u64().unwrap() < FRAMES as u64, "before the frames that wait: {seen}");
    let known = until("how many frames there are", &|_, acquisition| acquisition["views"][0]["frames"] == FRAMES);
    assert_eq!(known["state"], "open", "so that the previews can be judged as a whole before the completion");
    let report = uploader.report(WITHIN);
    assert_eq!((&report["frames"], &report["sent_previews"]), (&FRAMES.into(), &FRAMES.into()));
    let acquisition =
        get(&server.base, &token, &format!("acquisitions/{}", report["acquisition_id"].as_str().unwrap()));
    assert_eq!((&acquisition["state"], &acquisition["frames_present"]), (&"complete".into(), &FRAMES.into()));
}
