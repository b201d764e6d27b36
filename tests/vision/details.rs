//! Details of the image: cut where the rope's own course leads, over the ends of stretches, and what the network that looks at them makes of burns.

use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::model_file::Model;
use ropescope::pipeline::progress::Quiet;
use ropescope::pipeline::stretches::{STRETCH_LINES, StretchReader};
use ropescope::pipeline::{Acquisition, TrainOptions, TrainingRange, train};
use ropescope::simulate::defects::DefectKind;
use ropescope::simulate::{Label, Recipe, Scene, write_acquisition};
use ropescope::vision::aligner::{AlignedStretch, Aligner};
use ropescope::vision::camera::Camera;
use ropescope::vision::damage::Told;
use ropescope::vision::detail::{Details, LAYERS};
use ropescope::vision::detail_network::{DetailNetwork, SIDE};
use ropescope::vision::inspection_model::{AlignedView, Beside};
use ropescope::vision::kind::Likely;
use std::sync::OnceLock;
use tempfile::TempDir;

/// A rope in one view, with burns after the first 1.2 m; aligned, with a model of what comes before them.
struct Burnt {
    acquisition: Acquisition,
    model: Model,
    stretches: Vec<AlignedStretch>,
    cameras: Vec<Camera>,
    labels: Vec<Label>,
    _folder: TempDir,
}

fn burnt() -> &'static Burnt {
    static BURNT: OnceLock<Burnt> = OnceLock::new();
    BURNT.get_or_init(|| {
        let recipe = Recipe {
            metres: 2.0,
            defects: 5,
            defect_free_m: 1.2,
            defect_kind: Some(DefectKind::ArcBurn),
            view_angles_deg: vec![0.0],
            ..Recipe::photographic()
        };
        let folder = tempfile::tempdir().unwrap();
        let labels = write_acquisition(&Scene::new(&recipe, 12).unwrap(), folder.path(), |_| {}).unwrap();
        let (acquisition, frames) = open_folder(folder.path()).unwrap();
        let path = folder.path().join("rope.model");
        let range =
            TrainingRange { name: "intact", acquisition: &acquisition, source: &frames, from_m: None, to_m: Some(1.2) };
        train(&[range], TrainOptions::default(), &path, &Quiet).unwrap();
        let model = Model::read(&path).unwrap();
        let spec = acquisition.aligner_spec();
        let lines = spec.stretch_lines(STRETCH_LINES);
        let mut reader = StretchReader::new(&frames, spec.width_px, lines, 0..usize::MAX, None).unwrap();
        let (mut aligner, mut stretches) = (Aligner::new(spec), Vec::new());
        while let Some(stretch) = reader.next_stretch().unwrap() {
            stretches.extend(aligner.push(stretch));
        }
        stretches.extend(aligner.finish());
        let cameras = aligner.cameras().unwrap();
        Burnt { acquisition, model, stretches, cameras, labels, _folder: folder }
    })
}

impl Burnt {
    fn view(&self, stretch: usize) -> Option<AlignedView<'_>> {
        let rope = &self.acquisition.rope;
        AlignedView::of(rope, self.stretches.get(stretch)?, &self.cameras, 0, self.acquisition.line_pitch_mm)
    }

    fn details(&self, image: Beside<'_>, take: impl FnOnce(&mut Details<'_>)) {
        take(&mut Details::new(image, &self.model.views[0].gray, SIDE));
    }

    /// Places in view at the middle line of a block, one of each wire: strand, place, column.
    fn places(&self, stretch: usize, block: usize) -> Vec<(usize, usize, usize)> {
        let view = self.view(stretch).unwrap();
        let line = block * view.block_lines + view.block_lines / 2;
        let mut places = Vec::new();
        view.surface_map().for_each(line, view.view.axis_px[line], |point| {
            if point.place % 5 == 2 && places.last().is_none_or(|&(s, p, _)| (s, p) != (point.strand, point.place)) {
                places.push((point.strand, point.place, point.column));
            }
        });
        places
    }
}

/// Root mean square of a layer over the rows, leaving out what is not known.
fn rms(detail: &[f32], layer: usize, rows: std::ops::Range<usize>) -> f64 {
    let known = detail[rows.start * SIDE * LAYERS..rows.end * SIDE * LAYERS].chunks_exact(LAYERS).map(|v| v[layer]);
    let known: Vec<f64> = known.filter(|v| *v != 0.0).map(f64::from).collect();
    (known.iter().map(|v| v * v).sum::<f64>() / known.len().max(1) as f64).sqrt()
}

#[test]
fn intact_rope_deviates_little_in_details_on_either_side_of_the_end_of_a_stretch() {
    let burnt = burnt();
    let (before, itself) = (burnt.view(2), burnt.view(3));
    let mut told = Vec::new();
    burnt.details([before, itself, burnt.view(4)], |details| {
        for (strand, place, column) in burnt.places(3, 1) {
            if (160..320).contains(&column) {
                let detail = details.about(1, strand, place).unwrap();
                // The first rows show the stretch before: a course that were not joined, or rows that were taken from elsewhere, would
                // put wires where valleys are expected, which is 6 bins off.
                told.push((rms(detail, 1, 0..SIDE / 2 - 8), rms(detail, 1, SIDE / 2..SIDE)));
            }
        }
    });
    assert!(told.len() >= 3, "{told:?}");
    // In units of 4 bins.
    let mean = |of: fn(&(f64, f64)) -> f64| told.iter().map(of).sum::<f64>() / told.len() as f64;
    let (far, near) = (mean(|t| t.0), mean(|t| t.1));
    assert!(far > 0.02 && near > 0.02 && far < 0.5 && near < 0.5, "{far} {near}");
    assert!((far / near - 1.0).abs() < 0.4, "{far} {near}");
}

#[test]
fn a_wire_runs_straight_down_through_its_detail() {
    let burnt = burnt();
    const ON: usize = 20; // rows that four blocks of half a millimetre make
    let mut apart = Vec::new();
    burnt.details([burnt.view(2), burnt.view(3), burnt.view(4)], |details| {
        for (strand, place, column) in burnt.places(3, 100) {
            let later = details.about(104, strand, place).map(<[f32]>::to_vec);
            let (Some(here), Some(later)) = (details.about(100, strand, place), later) else { continue };
            if (140..340).contains(&column) {
                // The same rope, seen about two places of one wire: both show it in the same columns.
                let row = SIDE * LAYERS;
                let pairs = here[ON * row..].iter().zip(&later).step_by(LAYERS);
                let (sum, n) = pairs.fold((0.0, 0.0), |(sum, n), (a, b)| (sum + (a - b).abs(), n + 1.0));
                apart.push(sum / n);
            }
        }
    });
    let mean = apart.iter().sum::<f32>() / apart.len() as f32;
    assert!(apart.len() >= 4 && mean < 0.05, "{apart:?}");
}

#[test]
fn beyond_what_was_recorded_a_detail_is_empty_and_a_place_out_of_view_has_none() {
    let burnt = burnt();
    burnt.details([None, burnt.view(3), None], |details| {
        let (strand, place, _) = *burnt.places(3, 1).iter().find(|(_, _, column)| (200..280).contains(column)).unwrap();
        let detail = details.about(1, strand, place).unwrap().to_vec();
        // The block's middle line is the eighth.
        let empty = SIDE / 2 - 7;
        assert!(detail[..empty * SIDE * LAYERS].iter().all(|value| *value == 0.0));
        assert!(rms(&detail, 0, empty..SIDE) > 0.05);
        let in_view: Vec<usize> = burnt.places(3, 1).iter().map(|(strand, ..)| *strand).collect();
        let hidden = (0..6).find(|strand| !in_view.contains(strand)).unwrap();
        assert!(details.about(1, hidden, 2).is_none());
        assert!(details.about(100_000, strand, place).is_none());
    });
}

#[test]
fn burns_look_burnt_and_intact_rope_does_not() {
    let burnt = burnt();
    let (network, lines) = (DetailNetwork::trained(), burnt.stretches[0].lines);
    let doubted = Told { log_odds: -3.0, likely: Likely::default(), burn: false };
    let odds = |line: usize, columns: std::ops::RangeInclusive<usize>| {
        let (stretch, block) = (line / lines, line % lines / 5);
        let mut most = f32::NEG_INFINITY;
        let image = [burnt.view(stretch.wrapping_sub(1)), burnt.view(stretch), burnt.view(stretch + 1)];
        burnt.details(image, |details| {
            for (strand, place, column) in burnt.places(stretch, block) {
                if columns.contains(&column) {
                    let told = details.about(block, strand, place).map(|detail| network.look(detail, doubted, 5.0));
                    most = most.max(told.map_or(most, |told| told.log_odds));
                }
            }
        });
        most
    };
    let clear = burnt.labels.iter().filter(|label| label.clear && label.kind == "arc_burn");
    let burns: Vec<f32> = clear
        .filter(|label| label.first_column > 120 && label.last_column < 360)
        .map(|l| odds((l.first_line + l.last_line) / 2, l.first_column.saturating_sub(6)..=l.last_column + 6))
        .collect();
    assert!(burns.len() >= 2, "{:?}", burnt.labels);
    assert!(burns.iter().filter(|odds| **odds > 0.0).count() * 3 >= burns.len() * 2, "{burns:?}");
    let intact: Vec<f32> = (0..50).map(|k| odds(2_000 + 200 * k, 150..=330)).collect();
    assert!(intact.iter().filter(|odds| **odds > 0.0).count() <= 3, "{intact:?}");
}
