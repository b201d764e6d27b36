//! A disk that fills up.

use crate::process::{PROGRAM, Process, token};
use crate::recording::{assert_frames, get, get_text, post, recording};
use crate::uploader::{Uploader, free_port};
use serde_json::json;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const FRAMES: usize = 150;

/// A small disk, unmounted when dropped.
struct Tmpfs<'a>(&'a Path);

impl<'a> Tmpfs<'a> {
    fn mount(at: &'a Path, megabytes: usize) -> Self {
        let option = format!("size={megabytes}m");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &option, "tmpfs"]).arg(at).status().unwrap();
        assert!(mounted.success(), "mounting needs root");
        Self(at)
    }
}

impl Drop for Tmpfs<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.0).status();
    }
}

#[test]
#[ignore = "needs root, to mount a small disk"]
fn disk_full_is_a_clear_answer_and_the_upload_goes_on_when_there_is_room() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), FRAMES, 400); // 2 x 150 x 51 kB = 15 MB
    let _disk = Tmpfs::mount(data.path(), 40);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &["--reserve-mb", "4"]);
    // Something to work on while nothing more is taken.
    let rope = source.path().join("rope");
    let simulate = ["simulate", "--metres", "1", "--views", "1", "--seed", "3", "--out"];
    assert!(Command::new(PROGRAM).args(simulate).arg(&rope).output().unwrap().status.success());
    let whole = Uploader::start(&rope, &server.base, &token, &["--rope", "another"]).report(Duration::from_secs(60));
    std::fs::write(data.path().join("ballast"), vec![7; 24 << 20]).unwrap();
    // Who has no patience hears figures and an exit code of its own.
    let mut impatient = Uploader::start(source.path(), &server.base, &token, &["--patience-s", "1"]);
    let (status, error) = impatient.ended(Duration::from_secs(60));
    assert_eq!(status.code(), Some(5), "{error}");
    assert!(error.contains("bytes are needed") && error.contains("bytes left"), "{error}");
    // The others wait, and the service lives on meanwhile.
    let mut patient = Uploader::start(source.path(), &server.base, &token, &["--patience-s", "120"]);
    let begun = Instant::now();
    while !patient.said().iter().any(|line| line["event"] == "waiting") {
        assert!(begun.elapsed() < Duration::from_secs(30) && patient.running(), "{:?}", patient.said().last());
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(get_text(&server.base, &token, "/readyz").contains("ok"));
    assert_eq!(get(&server.base, &token, "ropeways")["items"].as_array().unwrap().len(), 2);
    let job = json!({"kind": "inspect", "acquisition_id": whole["acquisition_id"]});
    let job = post(&server.base, &token, "jobs", &job)["id"].as_str().unwrap().to_owned();
    let ended = loop {
        let job = get(&server.base, &token, &format!("jobs/{job}"));
        if !["queued", "running"].contains(&job["state"].as_str().unwrap()) {
            break job;
        }
        assert!(begun.elapsed() < Duration::from_secs(110), "{job}");
        std::thread::sleep(Duration::from_millis(100));
    };
    assert_eq!(ended["state"], "succeeded", "a job has the room that uploads leave: {ended}");
    assert!(patient.running(), "it waits meanwhile");
    std::fs::remove_file(data.path().join("ballast")).unwrap();
    let report = patient.report(Duration::from_secs(120));
    assert_frames(data.path(), report["acquisition_id"].as_str().unwrap(), source.path(), FRAMES);
}
