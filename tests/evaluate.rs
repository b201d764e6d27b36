//! `evaluate` against figures of an independent reference scorer over a small recording with made-up results: lay lengths
//! with gaps, a view of flipped sign, tied and missing line scores, a false defect.

use ropescope::evaluate::evaluate;
use serde_json::Value;
use std::path::Path;

/// Both sides compute in 64 bit; what differs is the order of sums.
const TOLERANCE: f64 = 1e-6;

fn assert_same(expected: &Value, found: &Value, at: &str) {
    match (expected, found) {
        (Value::Object(e), Value::Object(f)) => {
            assert_eq!(e.keys().collect::<Vec<_>>(), f.keys().collect::<Vec<_>>(), "keys of {at}");
            e.iter().for_each(|(key, value)| assert_same(value, &f[key], &format!("{at}/{key}")));
        }
        (Value::Array(e), Value::Array(f)) => {
            assert_eq!(e.len(), f.len(), "{at}");
            e.iter().zip(f).enumerate().for_each(|(n, (e, f))| assert_same(e, f, &format!("{at}/{n}")));
        }
        (Value::Number(e), Value::Number(f)) => {
            let [e, f] = [e, f].map(|x| x.as_f64().expect("JSON numbers without arbitrary precision are f64"));
            assert!((e - f).abs() <= TOLERANCE * e.abs().max(1.0), "{at}: expected {e}, found {f}");
        }
        _ => assert_eq!(expected, found, "{at}"),
    }
}

fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/evaluate"))
}

#[test]
fn figures_agree_with_the_reference_scorer() {
    for skip in [0, 400] {
        let expected = std::fs::read_to_string(folder().join(format!("expected_skip_{skip}.json"))).unwrap();
        let evaluation = evaluate(&folder().join("recording"), &folder().join("results"), skip).unwrap();
        let mut found = serde_json::to_value(&evaluation).unwrap();
        // The reference looks at lines only; all made-up alarms lie at the edge of the image, where no label is.
        let told_apart = found["detection"]["decisions"].as_object_mut().unwrap().remove("told_apart");
        assert_eq!(told_apart, Some(0.into()));
        assert_same(&serde_json::from_str(&expected).unwrap(), &found, &format!("skip {skip}"));
    }
}

#[test]
fn absent_results_are_said_to_be_absent() {
    let empty = tempfile::tempdir().unwrap();
    let evaluation = evaluate(&folder().join("recording"), empty.path(), 0).unwrap();
    let found = serde_json::to_value(&evaluation).unwrap();
    assert_eq!(found["lay_lengths"], serde_json::json!({"missing": true}));
    assert_eq!(found["displacement"], serde_json::json!({"missing": true}));
    assert_eq!(found["detection"], serde_json::json!({}));
    assert!(evaluation.to_string().contains("nothing to score"));
    let error = evaluate(&folder().join("recording"), &empty.path().join("no"), 0).unwrap_err();
    assert!(error.to_string().contains("no such results folder"), "{error}");
}

#[test]
fn a_reader_that_has_had_enough_is_no_failure() {
    // The reading end is closed before anything is printed, as `head` closes it after a few lines.
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    for form in [&[][..], &["--json"]] {
        let ran = std::process::Command::new(env!("CARGO_BIN_EXE_ropescope"))
            .arg("evaluate")
            .args([folder().join("recording"), folder().join("results")])
            .args(form)
            .stdout(writer.try_clone().unwrap())
            .output()
            .unwrap();
        assert!(ran.status.success() && ran.stderr.is_empty(), "{}", String::from_utf8_lossy(&ran.stderr));
    }
}
