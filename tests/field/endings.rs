//! How an upload ends: a number for the light on the box, and a sentence for the person before it.

use crate::process::{PROGRAM, Process, token};
use crate::recording::{frame_path, recording};
use crate::uploader::{Uploader, free_port};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const WITHIN: Duration = Duration::from_secs(60);

/// Exit code and sentence of an upload.
fn ending(folder: &Path, server: &str, token: &str, more: &[&str]) -> (Option<i32>, String) {
    let (status, error) = Uploader::start(folder, server, token, more).ended(WITHIN);
    (status.code(), error)
}

#[test]
fn every_ending_has_the_number_that_its_page_promises_and_says_what_to_do() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), 3, 60);
    let admin = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let end = |token: &str, more: &[&str]| ending(source.path(), &server.base, token, more);

    let nobody = format!("http://127.0.0.1:{}", free_port());
    let (code, said) = ending(source.path(), &nobody, &admin, &["--patience-s", "1"]);
    assert!(code == Some(3) && said.contains("run the same command again"), "{code:?} {said}");
    let (code, said) = end("rope_00_00", &[]);
    assert!(code == Some(4) && said.contains("the access token is not valid"), "{code:?} {said}");
    let made = Command::new(PROGRAM).args(["token", "create", "--role", "read", "--data"]).arg(data.path()).output();
    let reader = String::from_utf8(made.unwrap().stdout).unwrap().lines().last().unwrap().to_owned();
    let (code, said) = end(&reader, &[]);
    assert!(code == Some(4) && said.contains("the role read"), "{code:?} {said}");
    let (code, said) = end(&admin, &["--limit-mbit", "0"]);
    assert!(code == Some(2) && said.contains("above 0"), "{code:?} {said}");
    assert_eq!(end(&admin, &[]).0, Some(0));

    // Another rope under the same name, and a frame that has other bytes than the one that is there.
    let rope_json = source.path().join("rope.json");
    let before = std::fs::read(&rope_json).unwrap();
    let mut file: Value = serde_json::from_slice(&before).unwrap();
    file["rope_diameter_mm"] = json!(33.0);
    std::fs::write(&rope_json, file.to_string()).unwrap();
    let (code, said) = end(&admin, &[]);
    assert!(code == Some(6) && said.contains("--rope"), "{code:?} {said}");
    std::fs::write(&rope_json, before).unwrap();
    std::fs::copy(frame_path(source.path(), 0, 1), frame_path(source.path(), 1, 1)).unwrap();
    let (code, said) = end(&admin, &[]);
    assert!(code == Some(6) && said.contains("nothing was changed"), "{code:?} {said}");
    std::fs::remove_file(frame_path(source.path(), 0, 1)).unwrap();
    let (code, said) = end(&admin, &[]);
    assert!(code == Some(1) && said.contains("frame"), "{code:?} {said}");
}
