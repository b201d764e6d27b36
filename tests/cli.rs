//! `train` and `inspect` as people and scripts run them: the real binary on small simulated recordings, good and bad.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

use ropescope::simulate::write::encode_png;
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Columns of the recordings: half the usual, to be quick.
const SENSOR_PX: u32 = 240;

/// Intact rope of one view and a model of it; made once.
fn trained() -> &'static (TempDir, Value) {
    static TRAINED: OnceLock<(TempDir, Value)> = OnceLock::new();
    TRAINED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let recipe = Recipe {
            metres: 1.6,
            view_angles_deg: vec![30.0],
            sensor_px: SENSOR_PX,
            rope_width_px: 190.0,
            start_m: 100.0,
            ..Recipe::photographic()
        };
        write_acquisition(&Scene::new(&recipe, 5).unwrap(), &folder.path().join("rope"), |_| {}).unwrap();
        let ran = ropescope(folder.path(), &["train", "rope", "--out", "rope.model", "--json"]);
        assert!(ran.status.success(), "{}", text(&ran.stderr));
        let said = serde_json::from_slice(&ran.stdout).expect("one JSON object on stdout");
        (folder, said)
    })
}

fn ropescope(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ropescope")).current_dir(folder).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A copy of the recording, to be damaged.
fn copy() -> TempDir {
    let copy = tempfile::tempdir().unwrap();
    let rope = trained().0.path().join("rope");
    std::fs::create_dir_all(copy.path().join("rope/view0")).unwrap();
    for file in std::fs::read_dir(rope.join("view0")).unwrap() {
        let file = file.unwrap().path();
        std::fs::copy(&file, copy.path().join("rope/view0").join(file.file_name().unwrap())).unwrap();
    }
    std::fs::copy(rope.join("rope.json"), copy.path().join("rope/rope.json")).unwrap();
    copy
}

/// Changes `rope.json`.
fn edit(folder: &Path, change: impl FnOnce(&mut Value)) {
    let path = folder.join("rope/rope.json");
    let mut rope = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut rope);
    std::fs::write(path, rope.to_string()).unwrap();
}

/// Both commands refuse the recording with a message that holds all `words`, exit code 1 and nothing written.
fn refused(folder: &Path, words: &[&str]) {
    for command in [&["inspect", "rope", "--out", "results"][..], &["train", "rope", "--out", "new.model"]] {
        let ran = ropescope(folder, command);
        let said = text(&ran.stderr);
        assert_eq!(ran.status.code(), Some(1), "{said}");
        let last = said.lines().last().unwrap();
        assert!(last.starts_with("ropescope: ") && words.iter().all(|word| last.contains(word)), "{last}");
        assert!(!folder.join("results").exists() && !folder.join("new.model").exists(), "something was written");
    }
}

#[test]
fn a_rope_is_learnt_inspected_and_told_about() {
    let (folder, trained) = trained();
    let folder = folder.path();
    assert_eq!(trained["event"], "done");
    assert!(trained["report"]["threshold"].as_f64().unwrap().is_finite());
    assert!(folder.join("rope.model").is_file());

    let arguments = ["inspect", "rope", "--model", "rope.model", "--out", "good", "--maps", "--json"];
    let ran = ropescope(folder, &arguments);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let said: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!((&said["event"], &said["summary"]["metres"]), (&json!("done"), &json!(1.6)));
    // The simulated lay drifts by 2.2 mm about its nominal 220 mm.
    let strand_lay_mm = said["strand_lay"]["mean_mm"].as_f64().unwrap();
    assert!((strand_lay_mm - 220.0).abs() < 4.0, "{strand_lay_mm}");
    for line in text(&ran.stderr).lines() {
        let progress: Value = serde_json::from_str(line).expect("progress is JSON lines");
        assert!(progress["seconds_left"].is_number(), "{progress}");
    }
    for name in ["lay_lengths.csv", "displacement.csv", "line_scores.csv", "defects.json", "summary.json"] {
        assert!(folder.join("good").join(name).metadata().unwrap().len() > 1, "{name}");
    }
    let map = image::image_dimensions(folder.join("good/maps/view0/frame_000000.png")).unwrap();
    assert_eq!(map, image::image_dimensions(folder.join("rope/view0/frame_000000.png")).unwrap());

    // Earlier results are replaced, defects of a model included; people get sentences.
    let ran = ropescope(folder, &["inspect", "rope", "--out", "good"]);
    let said = text(&ran.stdout);
    assert!(ran.status.success() && said.contains("strand lay  2") && said.contains("not looked for"), "{said}");
    assert!(said.contains("not covered 0.00 of 1.60 m") && !folder.join("good/defects.json").exists(), "{said}");
    let names: Vec<_> = std::fs::read_dir(folder.join("good")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "{names:?}");
}

#[test]
fn places_to_look_at_again_are_told_and_listed_and_alarms_lie_on_the_rope() {
    let folder = trained().0.path();
    // So low that intact rope has both.
    let levels = ["--threshold", "3", "--look-again", "2"];
    let arguments = [&["inspect", "rope", "--model", "rope.model", "--out", "low", "--json"][..], &levels[..]].concat();
    let ran = ropescope(folder, &arguments);
    let said: Value = serde_json::from_slice(&ran.stdout).unwrap();
    let listed = |name: &str| -> Vec<Value> {
        serde_json::from_slice(&std::fs::read(folder.join("low").join(name)).unwrap()).unwrap()
    };
    let (defects, again) = (listed("defects.json"), listed("look_again.json"));
    assert!(defects.len() > 5 && !again.is_empty(), "{} and {}", defects.len(), again.len());
    assert_eq!(said["summary"]["look_again"], json!(again.len()));
    assert_eq!(said["look_again"], json!(again));

    // 190 columns of rope, which sways by a few.
    for alarm in defects.iter().chain(&again).flat_map(|place| place["alarms"].as_array().unwrap()) {
        let (first, last) = (alarm["first_column"].as_u64().unwrap(), alarm["last_column"].as_u64().unwrap());
        assert!((15..=last).contains(&first) && last < 225, "{alarm}");
    }
}

#[test]
fn surface_alarms_and_cards_come_with_the_results_and_go_with_them() {
    let folder = trained().0.path();
    let inspect = |options: &[&str]| {
        let ran = ropescope(folder, &[&["inspect", "rope", "--out", "carded", "--json"], options].concat());
        assert!(ran.status.success(), "{}", text(&ran.stderr));
        assert!(text(&ran.stderr).lines().all(|line| serde_json::from_str::<Value>(line).is_ok()));
        serde_json::from_slice::<Value>(&ran.stdout).unwrap()
    };
    let peaks = |said: &Value| -> Vec<f64> {
        said["defects"].as_array().unwrap().iter().map(|d| d["peak_score"].as_f64().unwrap()).collect()
    };
    // Intact rope has no defects, so a threshold is looked for that makes two places of it some: cards take seconds.
    let mut low = peaks(&inspect(&["--model", "rope.model", "--threshold", "3"]));
    low.sort_by(|a, b| b.total_cmp(a));
    let threshold = ((low[1] + low[2]) / 2.0).to_string();
    let said = inspect(&["--model", "rope.model", "--threshold", &threshold, "--cards"]);
    let defects = peaks(&said).len();
    assert!(defects >= 2, "{said}");

    let file = |name: &str| said["files"].as_array().unwrap().iter().any(|file| file.as_str().unwrap().ends_with(name));
    assert!(file("surface_alarms.csv") && file("cards") && !file("maps"), "{}", said["files"]);
    let results = folder.join("carded");
    assert!(!results.join("maps").exists(), "cards need maps, but nobody asked for them");
    let mut cards: Vec<_> =
        std::fs::read_dir(results.join("cards")).unwrap().map(|card| card.unwrap().file_name()).collect();
    cards.sort();
    assert_eq!(cards, (0..defects).map(|id| format!("defect_{id}.png").into()).collect::<Vec<std::ffi::OsString>>());
    let card = image::open(results.join("cards/defect_0.png")).unwrap().into_rgb8();
    // Gray values as they were observed and as intact rope has them are curves of their own.
    for colour in [[225, 85, 25], [0, 130, 150]] {
        assert!(card.pixels().filter(|dot| dot.0 == colour).count() > 1000, "{colour:?}");
    }

    let table = std::fs::read_to_string(results.join("surface_alarms.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|row| row.split(',').collect()).collect();
    assert_eq!(rows[0][..7], ["unit", "length", "length_m", "place", "from_m", "to_m", "surface_alarms"]);
    let worst: Vec<_> = rows.iter().filter(|row| row[3] == "worst").collect();
    let windows: Vec<_> = worst.iter().map(|row| (row[0], row[1])).collect();
    let diameters = ["6", "30", "40", "500"].map(|length| ("diameter", length));
    assert_eq!(windows, [&diameters[..], &[("lay", "1")]].concat());
    // 500 diameters of 32 mm are 16 m, and the rope has 1.6: the window is all of it.
    assert_eq!((worst[3][4], worst[3][5], worst[3][6]), ("100", "101.6", defects.to_string().as_str()));
    let side_by_side = rows.iter().filter(|row| row[3] == "series" && row[1] == "6").count();
    assert_eq!(side_by_side, 9, "1.6 m in windows of 0.192 m");

    inspect(&[]);
    assert!(!results.join("cards").exists() && !results.join("surface_alarms.csv").exists(), "they were of a model");
    let ran = ropescope(folder, &["inspect", "rope", "--out", "carded", "--cards"]);
    assert_eq!(ran.status.code(), Some(2), "without a model there are no defects");
}

#[test]
fn folders_and_files_of_something_else_are_not_written_to() {
    let folder = trained().0.path();
    for (arguments, words) in [
        (&["inspect", "rope", "--out", "rope"][..], "but no earlier results"),
        (&["inspect", "rope", "--out", "rope.model"], "is a file, but results are a folder"),
        (&["train", "rope", "--out", "rope"], "is a folder, but a model is a file"),
        (&["train", "rope", "--out", "rope/rope.json"], "exists and is no model"),
        (&["train", "rope", "--out", "no/where.model"], "there is no folder no"),
    ] {
        let ran = ropescope(folder, arguments);
        assert!(ran.status.code() == Some(1) && text(&ran.stderr).contains(words), "{}", text(&ran.stderr));
    }
}

#[test]
fn values_out_of_range_are_named_with_their_limits() {
    let folder = trained().0.path();
    for (options, words) in [
        (&["--from-m", "99.5"][..], "--from-m is 99.5, but the acquisition shows rope metres 100.00 to 101.60"),
        (&["--to-m", "nan"], "--to-m is NaN, but"),
        (&["--from-m", "101", "--to-m", "100.5"], "--from-m is 101, but must be less than --to-m, which is 100.5"),
        (&["--to-m", "100.4"], "but training needs at least"),
    ] {
        let ran = ropescope(folder, &[&["train", "rope", "--out", "range.model"], options].concat());
        assert!(ran.status.code() == Some(1) && text(&ran.stderr).contains(words), "{}", text(&ran.stderr));
        assert!(!folder.join("range.model").exists());
    }
    let ran = ropescope(folder, &["inspect", "rope", "--out", "none", "--threshold", "3"]);
    assert_eq!(ran.status.code(), Some(2), "a threshold without a model means nothing");
}

#[test]
fn several_ranges_teach_one_model_and_bounds_that_fit_no_folder_are_refused() {
    let folder = trained().0.path();
    let other = copy();
    edit(other.path(), |rope| rope["wires_per_strand"] = json!(8));
    let other = other.path().join("rope");
    let other = other.to_str().unwrap();
    let train = |arguments: &[&str]| ropescope(folder, &[&["train", "--out", "two.model"], arguments].concat());
    for (arguments, code, words) in [
        (
            &["rope", "rope", "--to-m", "101"][..],
            2,
            "--to-m is given once, but there are 2 folders: give it once for each",
        ),
        (&["rope", "--from-m", "101", "--from-m", "start"], 2, "--from-m is given 2 times, but there is 1 folder"),
        (&["rope", "--to-m", "start"], 2, "neither a rope metre nor the word \"end\""),
        (&["rope", other], 1, "a number of wires per strand of 8, but the first one has 9"),
        (&["rope", "./rope", "--to-m", "101", "--to-m", "end"], 1, "rope is named twice, with ranges that overlap"),
        (
            &["rope", "rope", "--from-m", "101", "--from-m", "3"],
            1,
            "rope: --from-m is 3, but the acquisition shows rope metres",
        ),
    ] {
        let ran = train(arguments);
        let said = text(&ran.stderr);
        assert!(ran.status.code() == Some(code) && said.contains(words), "{said}");
        assert!(!folder.join("two.model").exists());
    }
    let bounds = ["rope", "rope", "--from-m", "start", "--to-m", "100.8", "--from-m", "100.8", "--to-m", "end"];
    let ran = train(&[&bounds[..], &["--json"]].concat());
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let said: Value = serde_json::from_slice(&ran.stdout).unwrap();
    let gave = said["report"]["learnt_from"].as_array().unwrap();
    let ranges: Vec<_> = gave.iter().map(|r| (&r["acquisition"], r["from_m"].as_f64(), r["to_m"].as_f64())).collect();
    let rope = json!("rope");
    assert_eq!(ranges, [(&rope, Some(100.0), Some(100.8)), (&rope, Some(100.8), Some(101.6))]);
    let progress = text(&ran.stderr).lines().map(|line| serde_json::from_str(line).unwrap()).collect::<Vec<Value>>();
    assert!(progress.iter().all(|p| p["total_m"].as_f64().is_some_and(|m| (m - 1.6).abs() < 1e-9)), "{progress:?}");
    std::fs::remove_file(folder.join("two.model")).unwrap();
}

#[test]
fn a_truncated_frame_is_named() {
    let copy = copy();
    let path = copy.path().join("rope/view0/frame_000001.png");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    refused(copy.path(), &["frame_000001.png"]);
}

#[test]
fn a_header_of_60000_by_60000_is_refused_before_decoding() {
    let copy = copy();
    let path = copy.path().join("rope/view0/frame_000002.png");
    let mut png = std::fs::read(&path).unwrap();
    png[16..24].copy_from_slice(&[0, 0, 0xEA, 0x60, 0, 0, 0xEA, 0x60]);
    let crc = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    std::fs::write(&path, png).unwrap();
    refused(copy.path(), &["frame_000002.png", "60000x60000", "at most 16384 columns"]);
}

/// CRC of a PNG chunk.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

#[test]
fn a_rope_without_strands_is_refused() {
    let copy = copy();
    edit(copy.path(), |rope| drop(rope.as_object_mut().unwrap().remove("strands")));
    refused(copy.path(), &["rope.json", "missing field `strands`"]);
    edit(copy.path(), |rope| rope["strands"] = json!(0));
    refused(copy.path(), &["strands is 0, but must lie between 3 and 8"]);
}

#[test]
fn a_frame_of_another_width_is_refused() {
    let copy = copy();
    let png = encode_png(200, 10, &[9; 2000]).unwrap();
    std::fs::write(copy.path().join("rope/view0/frame_000003.png"), png).unwrap();
    refused(copy.path(), &["frame_000003.png", "200 columns", "240"]);
}

#[test]
fn a_missing_frame_is_named() {
    let copy = copy();
    std::fs::remove_file(copy.path().join("rope/view0/frame_000001.png")).unwrap();
    refused(copy.path(), &["frame_000001.png is missing"]);
}

#[test]
fn a_model_of_another_rope_or_camera_head_or_no_model_is_refused() {
    let model = trained().0.path().join("rope.model");
    for (key, value, model, words) in [
        (
            "wires_per_strand",
            json!(8),
            &*model,
            "trained on rope with a number of wires per strand of 9, but this acquisition shows 8: use a model of this rope",
        ),
        (
            "line_pitch_mm",
            json!(0.3),
            &*model,
            "trained on recordings with a line pitch of 0.1 mm, but this acquisition has 0.3 mm: use a model",
        ),
        ("start_m", json!(3.0), Path::new("rope/rope.json"), "is not a usable appearance model"),
    ] {
        let copy = copy();
        edit(copy.path(), |rope| rope[key] = value);
        let ran = ropescope(copy.path(), &["inspect", "rope", "--out", "results", "--model", model.to_str().unwrap()]);
        assert!(ran.status.code() == Some(1) && text(&ran.stderr).contains(words), "{}", text(&ran.stderr));
        assert!(!copy.path().join("results").exists());
    }
}

#[test]
fn frames_without_rope_give_rows_without_estimates_and_a_reason() {
    let copy = copy();
    let gray = encode_png(SENSOR_PX, 2000, &[128; SENSOR_PX as usize * 2000]).unwrap();
    for frame in std::fs::read_dir(copy.path().join("rope/view0")).unwrap() {
        std::fs::write(frame.unwrap().path(), &gray).unwrap();
    }
    let model = trained().0.path().join("rope.model");
    let arguments = ["inspect", "rope", "--out", "results", "--maps", "--model", model.to_str().unwrap()];
    let ran = ropescope(copy.path(), &arguments);
    let said = text(&ran.stdout);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    assert!(said.contains("not measured anywhere") && said.contains("defects     0"), "{said}");
    assert!(said.contains("not covered 1.60 of 1.60 m"), "{said}");
    let table = std::fs::read_to_string(copy.path().join("results/lay_lengths.csv")).unwrap();
    assert!(table.lines().count() > 8);
    for row in table.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        assert!(cells[4].is_empty() && !cells[cells.len() - 1].is_empty(), "{row}");
    }
    let ran = ropescope(copy.path(), &["train", "rope", "--out", "new.model"]);
    assert!(ran.status.code() == Some(1) && text(&ran.stderr).contains("only 0.00 m"), "{}", text(&ran.stderr));
}

#[test]
fn contours_measured_elsewhere_are_used_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { metres: 1.2, sensor_px: 480, ..Recipe::artificial() };
    write_acquisition(&Scene::new(&recipe, 3).unwrap(), &folder.path().join("paper"), |_| {}).unwrap();
    let arguments = ["inspect", "paper", "--contours", "given", "--out", "results", "--json"];
    let ran = ropescope(folder.path(), &arguments);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let said: Value = serde_json::from_slice(&ran.stdout).unwrap();
    // The artificial lay drifts between 123 and 152 mm.
    let strand_lay_mm = said["strand_lay"]["mean_mm"].as_f64().unwrap();
    assert!((118.0..157.0).contains(&strand_lay_mm), "{strand_lay_mm}");

    let path = folder.path().join("paper/contours0.csv");
    let mut contours: Vec<String> = std::fs::read_to_string(&path).unwrap().lines().map(str::to_owned).collect();
    contours[7] = "6,inf,430".into();
    std::fs::write(&path, contours.join("\n")).unwrap();
    let said = text(&ropescope(folder.path(), &arguments).stderr);
    assert!(said.contains("contours0.csv, row 8 (line 6): lower_px is \"inf\""), "{said}");
    std::fs::remove_file(&path).unwrap();
    let ran = ropescope(folder.path(), &arguments);
    assert!(ran.status.code() == Some(1) && text(&ran.stderr).contains("contours0.csv"), "{}", text(&ran.stderr));
}

#[cfg(unix)]
#[test]
fn an_interrupt_stops_the_run_and_leaves_nothing() {
    let folder = trained().0.path();
    let mut child = Command::new(env!("CARGO_BIN_EXE_ropescope"))
        .current_dir(folder)
        .args(["train", "rope", "--out", "interrupted.model"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    said.read_line(&mut line).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(300)); // it listens from now on, and runs for seconds
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let rest: Vec<String> = said.lines().map(Result::unwrap).collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    assert_eq!(rest.last().unwrap(), "ropescope: stopped; nothing was written");
    let files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(!files.iter().any(|f| f.ends_with("interrupted.model")), "{files:?}");
}
