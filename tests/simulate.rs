//! Simulated acquisitions are what the rest of the program reads, the same for the same seed, and true.

use ropescope::pipeline::acquisition::open_folder;
use ropescope::simulate::{Background, Label, Recipe, Scene, render_view_frame, write_acquisition};
use std::path::Path;
use std::process::Command;

fn small() -> Recipe {
    Recipe { metres: 0.06, frame_lines: 250, defects: 0, ..Recipe::photographic() }
}

fn gray(folder: &Path, view: usize, frame: usize) -> Vec<u8> {
    let path = folder.join(format!("view{view}/frame_{frame:06}.png"));
    image::open(path).expect("the frame was just written").into_luma8().into_raw()
}

#[test]
fn a_written_acquisition_opens_and_its_frames_are_those_that_are_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::new(&small(), 7).unwrap();
    write_acquisition(&scene, folder.path(), |_| {}).unwrap();
    let (acquisition, _) = open_folder(folder.path()).unwrap();
    assert_eq!(acquisition.view_angles_rad.len(), 4);
    assert_eq!((scene.lines(), scene.frames(), scene.frame_height(2)), (600, 3, 100));
    for (view, frame) in [(0, 0), (3, 2)] {
        assert_eq!(gray(folder.path(), view, frame), render_view_frame(&scene, view, frame));
    }
    assert!(render_view_frame(&scene, 4, 0).is_empty() && render_view_frame(&scene, 0, 3).is_empty());
}

#[test]
fn the_seed_decides_everything() {
    let frame = |seed| render_view_frame(&Scene::new(&small(), seed).unwrap(), 1, 1);
    assert_eq!(frame(7), frame(7));
    assert_ne!(frame(7), frame(8));
}

#[test]
fn options_of_light_and_noise_do_not_move_the_rope() {
    let scene = Scene::new(&small(), 3).unwrap();
    let dark = Scene::new(&Recipe { exposure: 0.3, gray_noise: 9.0, dirt: 1.0, bad_columns: 9, ..small() }, 3).unwrap();
    for line in [0, 250, 599] {
        assert_eq!(scene.displacement_px(line, 2), dark.displacement_px(line, 2));
        assert_eq!(scene.strand_phase_rad(1, scene.x_mm(line)), dark.strand_phase_rad(1, dark.x_mm(line)));
    }
}

#[test]
fn every_construction_hand_and_background_shows_rope_in_the_middle() {
    let backgrounds = [Background::Dark, Background::Bright, Background::Shadow];
    for (n, (strands, wires)) in [(3, 5), (3, 16), (8, 5), (8, 16), (6, 7), (4, 12)].into_iter().enumerate() {
        for (strand_hand, wire_hand) in [(1.0, -1.0), (-1.0, -1.0)] {
            let recipe = Recipe { metres: 0.02, frame_lines: 200, view_angles_deg: vec![30.0], ..small() };
            let mut recipe = recipe.with_construction(strands, wires, 28.0);
            recipe.strand_lay_mm *= strand_hand;
            recipe.wire_lay_mm *= -wire_hand;
            recipe.background = backgrounds[n % 3];
            let scene = Scene::new(&recipe, 5).unwrap();
            let frame = render_view_frame(&scene, 0, 0);
            let mean = |from: usize, to: usize| {
                let rows = frame.chunks_exact(480);
                let sum: f64 = rows.map(|r| r[from..to].iter().map(|&g| f64::from(g)).sum::<f64>()).sum();
                sum / (200 * (to - from)) as f64
            };
            let rope = mean(140, 340);
            assert!((30.0..190.0).contains(&rope), "{strands}x{wires} {strand_hand} {wire_hand}: {rope}");
            match recipe.background {
                Background::Dark => assert!(mean(0, 30) < 20.0),
                Background::Bright | Background::Shadow => assert!(mean(0, 30) > 120.0),
            }
        }
    }
}

#[test]
fn the_edge_of_the_rope_in_the_image_is_where_the_truth_puts_it() {
    let recipe = Recipe { gray_noise: 0.0, dirt: 0.0, background: Background::Bright, bad_columns: 0, ..small() };
    let scene = Scene::new(&recipe, 2).unwrap();
    let widest = recipe.rope_width_px / 2.0;
    let frame = render_view_frame(&scene, 0, 0);
    for (line, row) in frame.chunks_exact(480).enumerate() {
        let axis_px = 239.5 + scene.displacement_px(line, 0);
        let left = row.windows(2).position(|w| w[0] > 120 && w[1] <= 120).unwrap() as f64;
        let right = 479.0
            - row.iter().rev().collect::<Vec<_>>().windows(2).position(|w| *w[0] > 120 && *w[1] <= 120).unwrap() as f64;
        assert!(left > axis_px - widest - 2.0 && right < axis_px + widest + 2.0, "line {line}: {left} {right}");
        assert!(right - left > 0.88 * recipe.rope_width_px, "line {line}: {left} {right}");
    }
}

#[test]
fn labels_lie_where_defects_changed_the_picture() {
    let intact = Recipe { metres: 1.2, defects: 0, ..Recipe::photographic() };
    let damaged = Recipe { defects: 8, ..intact.clone() };
    let (intact, damaged) = (Scene::new(&intact, 9).unwrap(), Scene::new(&damaged, 9).unwrap());
    let labels = ropescope::simulate::labels::labels(&damaged);
    let clear: Vec<&Label> = labels.iter().filter(|l| l.clear).collect();
    assert!(clear.len() >= 8, "{}", clear.len());
    for label in clear.iter().step_by(3) {
        let middle = (label.first_line + label.last_line) / 2;
        let (frame, line) = (middle / 2000, middle % 2000);
        let row = |scene: &Scene| render_view_frame(scene, label.view, frame)[line * 480..][..480].to_vec();
        let (before, after) = (row(&intact), row(&damaged));
        let change = |from: usize, to: usize| -> u32 {
            (from..to).map(|c| u32::from(before[c].abs_diff(after[c]))).max().unwrap_or(0)
        };
        assert!(change(label.first_column, label.last_column + 1) > 12, "{label:?}");
    }
}

#[test]
fn the_command_refuses_a_folder_that_is_not_empty_and_says_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    let run = |extra: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ropescope"));
        command.args(["simulate", "--metres", "0.02", "--views", "1", "--out"]).arg(folder.path()).args(extra);
        command.output().unwrap()
    };
    let refused = run(&[]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--force"));
    assert!(!folder.path().join("rope.json").exists());
    let wrong = run(&["--force", "--dirt", "7"]);
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("dirt is 7, but must lie between 0 and 1"));
    assert!(run(&["--force"]).status.success());
    assert!(folder.path().join("rope.json").exists() && folder.path().join("notes.txt").exists());
}

#[test]
fn the_artificial_kind_writes_contours_with_the_noise_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { metres: 0.2, ..Recipe::artificial() };
    write_acquisition(&Scene::new(&recipe, 1).unwrap(), folder.path(), |_| {}).unwrap();
    let quiet = tempfile::tempdir().unwrap();
    let recipe = Recipe { contour_noise_px: 0.0, ..recipe };
    write_acquisition(&Scene::new(&recipe, 1).unwrap(), quiet.path(), |_| {}).unwrap();
    let upper = |folder: &Path| -> Vec<f64> {
        let mut table = csv::Reader::from_path(folder.join("contours0.csv")).unwrap();
        table.records().map(|r| r.unwrap()[2].parse().unwrap()).collect()
    };
    let (noisy, exact) = (upper(folder.path()), upper(quiet.path()));
    let squares: f64 = noisy.iter().zip(&exact).map(|(a, b)| (a - b).powi(2)).sum();
    let sd = (squares / exact.len() as f64).sqrt();
    assert_eq!(exact.len(), 2000);
    assert!((sd - 1.0).abs() < 0.08, "{sd}"); // 5 standard errors of 2,000 draws
}
