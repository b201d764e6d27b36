//! `evaluate alignment` and `evaluate detection` as people run them: the quick form of both writes a whole report, `evaluate DIR
//! RESULTS` stays what it was, and wrong options are answered with the way out.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

use std::path::Path;
use std::process::{Command, Output};

fn evaluate(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ropescope")).current_dir(folder).arg("evaluate").args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The page of a report whose figures and numbers are all there, and no number of which was forgotten.
fn whole_page(folder: &Path, figures: &[&str], tables: &[&str]) -> String {
    let page = std::fs::read_to_string(folder.join("report.md")).unwrap();
    for name in figures {
        let drawn = std::fs::read_to_string(folder.join(name)).unwrap();
        assert!(page.contains(&format!("]({name})")) && drawn.ends_with("</svg>\n"), "{name}");
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"), "{name}");
    }
    for name in tables {
        let numbers = std::fs::read_to_string(folder.join(name)).unwrap();
        assert!(page.contains(&format!("]({name})")) && numbers.lines().count() > 3, "{name}");
    }
    page
}

/// Number in a cell of the row of a page's table that begins with `first`, whichever table has it first.
fn cell(page: &str, first: &str, column: usize) -> f64 {
    let row = page.lines().find(|line| line.starts_with(&format!("| {first} |"))).unwrap_or_else(|| panic!("{first}"));
    let cell = row.split('|').nth(column + 1).unwrap().trim();
    cell.trim_end_matches(" %").parse().unwrap_or_else(|_| panic!("{cell} in {row}"))
}

#[test]
fn the_report_about_lay_lengths_is_whole_and_near_the_bound() {
    let folder = tempfile::tempdir().unwrap();
    let ran = evaluate(folder.path(), &["alignment", "--out", "report", "--quick", "--seed", "3"]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    assert_eq!(text(&ran.stdout).trim(), "report/report.md");
    assert!(text(&ran.stderr).contains("s left"), "progress says how long it takes: {}", text(&ran.stderr));
    let figures = ["noise.svg", "tracking.svg", "short-rope.svg", "deformation.svg"];
    let tables = ["noise.csv", "tracking.csv", "short-rope.csv", "deformation.csv"];
    let page = whole_page(&folder.path().join("report"), &figures, &tables);
    assert!(page.contains("`ropescope evaluate alignment --out report --quick --seed 3`, seed 3, 20"), "{page}");
    // Six stretches a level: noise is more than the least, and the error is of the size of the bound.
    let bounds = &page[page.find("Beside the Cramer-Rao bound").unwrap()..];
    for noise in ["0.5 | 5", "4 | 40"] {
        let ratio = cell(bounds, noise, 4);
        assert!((0.1..5.0).contains(&ratio), "{noise}: {ratio}");
    }
    let short = cell(&page, "Seq. 3", 2);
    assert!((short - 133.0).abs() < 1.5, "{short}"); // drifts by 0.7 mm, and the program was told 137.5
    let repeated = &page[page.find("## Repeatability").unwrap()..];
    assert!(cell(repeated, "wires", 2) < 0.5); // per cent
    assert!(cell(&page, "rms of the deformation, px", 2) < 0.5); // of up to 4 px
    let lost = &page[page.find("## Lost locks").unwrap()..];
    assert_eq!(cell(lost, "strands", 1), 0.0);
}

#[test]
fn the_report_about_defects_is_whole_and_finds_more_than_chance() {
    let folder = tempfile::tempdir().unwrap();
    let ran = evaluate(folder.path(), &["detection", "--out", "report", "--quick"]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let figures = ["roc.svg", "defects.svg", "ablation.svg"];
    let page = whole_page(&folder.path().join("report"), &figures, &["roc.csv", "defects.csv"]);
    for view in ["0", "1"] {
        let auc = cell(&page, view, 1);
        assert!((0.75..=1.0).contains(&auc), "view {view}: {auc}"); // 0.5 is chance
    }
    assert!(
        page.contains("| the paper's |") && page.contains("| scores that last |") && page.contains("| missing wire |"),
        "{page}"
    );
    assert!(page.contains("to look at again with 5 cm of context"), "{page}");
}

#[test]
fn an_existing_recording_gets_the_same_report() {
    let tests = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/evaluate"));
    let folder = tempfile::tempdir().unwrap();
    let (recording, results) = (tests.join("recording"), folder.path().join("results"));
    std::fs::create_dir(&results).unwrap();
    for name in ["line_scores.csv", "defects.json"] {
        std::fs::copy(tests.join("results").join(name), results.join(name)).unwrap();
    }
    let summary = r#"{"lines": 1800, "threshold": {"line_score": 1.0, "origin": "made up"}}"#;
    std::fs::write(results.join("summary.json"), summary).unwrap();
    let recording = recording.to_str().unwrap();
    let ran =
        evaluate(folder.path(), &["detection", "--out", "page", "--recording", recording, "--results", "results"]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let page = whole_page(&folder.path().join("page"), &["roc.svg", "defects.svg"], &["roc.csv", "defects.csv"]);
    // The scorer of single results says the same of the first view.
    let ran = evaluate(folder.path(), &[recording, "results", "--json"]);
    let scored: serde_json::Value = serde_json::from_slice(&ran.stdout).unwrap();
    let auc = scored["detection"]["views"][0]["auc"].as_f64().unwrap();
    assert!((cell(&page, "0", 1) - auc).abs() < 1e-4, "{auc}");
    assert!(page.contains("(made up)"), "{page}");
}

#[test]
fn wrong_options_are_answered_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("photos")).unwrap();
    std::fs::write(folder.path().join("photos/holiday.jpg"), "").unwrap();
    for (arguments, code, words) in [
        (&["alignment", "--out", "photos", "--quick"][..], 1, "but no earlier report: choose another folder"),
        (&["alignment", "--out", "r", "--ropes", "0"], 1, "--ropes is 0, but must lie between 1 and 1000"),
        (&["alignment", "--out", "r", "--metres", "nan"], 1, "--metres is NaN, but must lie between 1 and 1000"),
        (&["alignment"], 2, "--out <DIR>"),
        (&["alignment", "--out", "r", "--quick", "--metres", "3"], 2, "cannot be used with"),
        (&["detection", "--out", "r", "--metres", "5"], 1, "--metres is 5, but must lie between 6 and 1000"),
        (&["detection", "--out", "r", "--metres", "6.5"], 1, "simulate more metres or fewer defects"),
        (&["detection", "--out", "r", "--recording", "photos"], 2, "--results <RESULTS>"),
        (&["rope-a"], 2, "<RESULTS>"),
        (&[], 2, "<DIR>"),
    ] {
        let ran = evaluate(folder.path(), arguments);
        let said = text(&ran.stderr);
        assert_eq!(ran.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(said.contains(words), "{arguments:?}: {said}");
        assert!(!folder.path().join("r/report.md").exists(), "{arguments:?}");
    }
}
