//! From a folder of frames to lay lengths and their errors, through everything a user would run but the command line.

use ropescope::evaluate::evaluate;
use ropescope::evaluate::lay_lengths::StretchErrors;
use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::progress::Quiet;
use ropescope::pipeline::{InspectOptions, inspect};
use ropescope::simulate::{Recipe, Scene, write_acquisition};

/// Six stretches of 0.2 m: five to find the rope in, one to follow it. The cameras see twice the usual line pitch and half the
/// usual width, to be quick.
fn small(views: usize) -> Recipe {
    Recipe {
        metres: 1.2,
        frame_lines: 2000,
        sensor_px: 360,
        rope_width_px: 290.0,
        view_angles_deg: Recipe::evenly_spaced(views),
        ..Recipe::photographic()
    }
}

fn errors(recipe: &Recipe) -> StretchErrors {
    let folder = tempfile::tempdir().unwrap();
    let results = tempfile::tempdir().unwrap();
    write_acquisition(&Scene::new(recipe, 3).unwrap(), folder.path(), |_| {}).unwrap();
    let (acquisition, frames) = open_folder(folder.path()).unwrap();
    inspect(&acquisition, &frames, &InspectOptions::default(), results.path(), &Quiet).unwrap();
    let evaluation = evaluate(folder.path(), results.path(), 0).unwrap();
    evaluation.lay_lengths.fused.expect("estimates of all views together")
}

fn check(recipe: &Recipe) {
    let errors = errors(recipe);
    eprintln!("{}x{} {} views {errors:?}", recipe.strands, recipe.wires_per_strand, recipe.view_angles_deg.len());
}

#[test]
fn six_strands_of_nine_wires() {
    check(&small(4));
    check(&small(1));
}

#[test]
fn eight_strands_of_seven_wires_lang_lay_left_hand() {
    let hand = |recipe: Recipe| Recipe { strand_lay_mm: -recipe.strand_lay_mm.abs(), ..recipe };
    check(&hand(small(4)).with_construction(8, 7, 28.0));
    check(&hand(small(1)).with_construction(8, 7, 28.0));
}

#[test]
fn five_strands_of_eight_wires() {
    check(&small(4).with_construction(5, 8, 28.0));
    check(&small(1).with_construction(5, 8, 28.0));
}
