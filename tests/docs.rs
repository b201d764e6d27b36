//! The documents name only commands and options that exist, and link only to files that do.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

const DOCUMENTS: [&str; 5] = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/upload.md"];

fn read(document: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(document)).unwrap()
}

/// Everything in a document that runs the program, as its arguments.
fn commands(document: &str) -> Vec<Vec<String>> {
    let text = read(document);
    let blocks = text.split("```").skip(1).step_by(2).flat_map(str::lines).filter(|line| !line.starts_with('#'));
    let mut found = Vec::new();
    for line in blocks {
        for beginning in ["ropescope ", "cargo run --release -- "] {
            let Some((before, arguments)) = line.split_once(beginning) else { continue };
            if before.is_empty() || before.ends_with("$(") {
                found.push(
                    arguments.split_whitespace().take_while(|a| !["|", "#"].contains(a)).map(str::to_owned).collect(),
                );
            }
        }
    }
    found
}

fn help(command: &[&str]) -> String {
    let ran = Command::new(env!("CARGO_BIN_EXE_ropescope")).args(command).arg("--help").output().unwrap();
    assert!(ran.status.success(), "there is no command {command:?}");
    String::from_utf8(ran.stdout).unwrap()
}

#[test]
fn documents_name_commands_and_options_that_exist() {
    let all: Vec<Vec<String>> = DOCUMENTS.iter().flat_map(|document| commands(document)).collect();
    assert!(all.len() > 5, "the README shows how to use the program: {all:?}");
    for arguments in &all {
        let plain: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let two_words =
            plain[0] == "token" || (plain[0] == "evaluate" && ["alignment", "detection"].contains(&plain[1]));
        let words = if two_words { 2 } else { 1 };
        let help = help(&plain[..words]);
        for option in plain[words..].iter().filter(|a| a.starts_with("--")) {
            assert!(help.contains(option), "{arguments:?}: there is no {option}");
        }
    }
}

#[test]
fn every_command_teaches_by_its_help_and_is_in_the_changelog() {
    let help = help(&[]);
    let listed = help.lines().skip_while(|line| !line.starts_with("Commands:")).skip(1);
    let names: BTreeSet<&str> = listed
        .take_while(|line| !line.is_empty())
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .collect();
    assert!(names.contains("inspect") && names.len() > 8, "{names:?}");
    let changelog = read("CHANGELOG.md");
    for name in names {
        assert!(changelog.contains(&format!("`{name}`")), "{name}");
    }
}

#[test]
fn documents_link_to_files_that_exist() {
    for document in DOCUMENTS {
        for link in read(document).split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let exists = Path::new(env!("CARGO_MANIFEST_DIR")).join(link).exists();
            assert!(exists || link.starts_with("http"), "{document} links to {link}");
        }
    }
}
