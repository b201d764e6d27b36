//! The walls between the modules, as ARCHITECTURE.md draws them.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

use std::path::{Path, PathBuf};

/// Which other modules of the program a module may name.
const MAY_NAME: [(&str, &[&str]); 9] = [
    ("vision", &[]),
    ("pipeline", &["vision"]),
    ("simulate", &["pipeline", "vision"]),
    ("evaluate", &[]),
    ("store", &["pipeline", "vision"]),
    ("workers", &["app", "pipeline", "store"]),
    ("ticketing", &["clock", "store", "tls"]),
    ("upload", &["pipeline", "tls"]),
    ("http", &["app", "config", "pipeline", "store", "ticketing", "vision"]),
];

/// What vision does without: I/O, time, chance, serialisation, async, logs, global state.
const NOT_IN_VISION: [&str; 21] = [
    "std::fs",
    "std::io",
    "std::net",
    "std::time",
    "std::env",
    "std::process",
    "std::thread",
    "std::sync",
    "static mut",
    "println!",
    "serde",
    "tokio",
    "futures",
    "axum",
    "sqlx",
    "reqwest",
    "tracing",
    "rand::",
    "jiff",
    "csv::",
    "tempfile",
];

fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
    }
    found
}

fn module(name: &str) -> Vec<(PathBuf, String)> {
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(name))
}

/// Lines of code: comments may name anything.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(text.lines()).filter(|(_, line)| !line.trim_start().starts_with("//"))
}

#[test]
fn modules_name_only_those_below_them() {
    for (name, allowed) in MAY_NAME {
        for (path, text) in module(name) {
            for (number, line) in code(&text) {
                for rest in line.split("crate::").skip(1) {
                    let other = rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
                    let fine = other == name || allowed.contains(&other);
                    assert!(fine, "{}:{number}: {name} may not name {other}", path.display());
                }
            }
        }
    }
}

#[test]
fn vision_is_numbers_and_images_only() {
    let files = module("vision");
    assert!(files.len() > 15, "this looks at the paper's modules");
    for (path, text) in files {
        for (number, line) in code(&text) {
            for word in NOT_IN_VISION {
                let alone = |(at, _): (usize, &str)| !line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
                assert!(
                    !line.match_indices(word).any(alone),
                    "{}:{number}: vision does without {word}",
                    path.display()
                );
            }
        }
    }
}

#[test]
fn only_the_store_has_sql() {
    for (path, text) in module("") {
        let store = path.components().any(|c| c.as_os_str() == "store");
        assert!(store || !text.contains("sqlx::"), "{} names sqlx", path.display());
    }
}
