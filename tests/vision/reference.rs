//! The fast way to the wires (unwrapping and tracking) against the paper's (eq. 14), both against the truth, on ropes drawn by
//! image synthesis: regular helices, gray noise, a swinging axis, contours from the model with their own noise.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use ropescope::vision::aligner::{AlignedStretch, Aligner, AlignerSpec, Stretch};
use ropescope::vision::camera::Camera;
use ropescope::vision::contour::Contours;
use ropescope::vision::model_contour::ModelContour;
use ropescope::vision::rope::{Rope, RopeDesign};
use ropescope::vision::strand::StrandHelix;
use ropescope::vision::synthesis::{Raster, gray_image, synthesise};
use ropescope::vision::wire::WireHelix;
use ropescope::vision::wire_alignment::{StrandPixels, ViewLines};

const PITCH_MM: f64 = 0.2;
const WIDTH_PX: usize = 420;
const STRETCHES: usize = 6;
const GRAY_NOISE: f32 = 20.0;
const CONTOUR_NOISE_PX: f32 = 0.5;

struct Drawn {
    rope: Rope,
    camera: Camera,
    strand: StrandHelix,
    wires: Vec<WireHelix>,
}

fn drawn(strands: usize, wires_per_strand: usize, strand_lay_mm: f64, wire_lay_mm: f64) -> Drawn {
    let rope = RopeDesign {
        strands,
        wires_per_strand,
        diameter_mm: 24.0,
        strand_lay_mm: Some(strand_lay_mm),
        wire_lay_mm: Some(wire_lay_mm),
        strand_diameter_mm: None,
        wire_diameter_mm: None,
    };
    Drawn {
        rope: rope.validate().unwrap(),
        camera: Camera { angle_rad: 0.0, distance_mm: 168.0, px_per_mm: 14.0 },
        // 3 % off the nominal lays: to be found, not to be assumed.
        strand: StrandHelix { lay_length_mm: 1.03 * strand_lay_mm, offset_rad: 0.2 },
        wires: (0..strands)
            .map(|j| WireHelix { lay_length_mm: wire_lay_mm * (0.95 + 0.02 * j as f64), offset_rad: 0.37 * j as f64 })
            .collect(),
    }
}

/// Gaussian enough: the sum of twelve uniform numbers.
fn normal(rng: &mut ChaCha8Rng) -> f32 {
    (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0
}

fn align(drawn: &Drawn) -> (Vec<AlignedStretch>, Camera, usize) {
    let Drawn { rope, camera, strand, wires } = drawn;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let spec = AlignerSpec::new(rope.clone(), PITCH_MM, vec![0.0], WIDTH_PX, None);
    let lines = spec.stretch_lines(1000);
    let mut aligner = Aligner::new(spec);
    let contour = ModelContour::new(rope, camera);
    let mut aligned = Vec::new();
    for stretch in 0..STRETCHES {
        let first_line = stretch * lines;
        let raster = Raster { lines: first_line..first_line + lines, pitch_mm: PITCH_MM, width_px: WIDTH_PX };
        let axis_px = |line: usize| 209.5 + 4.0 * (line as f64 / 170.0).sin();
        let brightness = synthesise(rope, camera, *strand, wires, &raster, axis_px);
        let image = gray_image(&brightness, WIDTH_PX, 10.0, 200.0, || GRAY_NOISE * normal(&mut rng)).unwrap();
        let edges = raster.lines.clone().map(|line| {
            let phase = camera.phase_in_view(strand.phase_rad(rope, 0, line as f64 * PITCH_MM));
            let edge = |model_px: f64, rng: &mut ChaCha8Rng| {
                (axis_px(line) + model_px) as f32 + CONTOUR_NOISE_PX * normal(rng)
            };
            (edge(contour.lower_px(phase), &mut rng), edge(contour.upper_px(phase), &mut rng))
        });
        let (lower_px, upper_px) = edges.unzip();
        let given_contours = Some(vec![Contours { lower_px, upper_px }]);
        aligned.extend(aligner.push(Stretch { first_line, lines, images: vec![image], given_contours }));
    }
    aligned.extend(aligner.finish());
    let camera = aligner.cameras().expect("the aligner found the rope")[0];
    (aligned, camera, lines)
}

/// Checks both ways on one stretch. Tolerances in mm: one view with noise of a tenth of the contrast; the paper reports 0.06 mm
/// (strands) and 0.23 mm (wires) for frames of this length.
fn check(strands: usize, wires: usize, strand_lay_mm: f64, wire_lay_mm: f64) {
    let drawn = drawn(strands, wires, strand_lay_mm, wire_lay_mm);
    let (aligned, camera, lines) = align(&drawn);
    assert_eq!(aligned.len(), STRETCHES);
    let rope = &drawn.rope;
    let mut compared = 0;
    for stretch in &aligned[1..STRETCHES - 1] {
        let estimates = stretch.estimates.as_ref().expect("every stretch shows the rope");
        let found = estimates.fused.strand.expect("the strands are in the image");
        eprintln!("strand {:.4} sd {:.4}", found.lay_mm - drawn.strand.lay_length_mm, found.lay_sd_mm);
        for (j, wire) in estimates.fused.wires.iter().enumerate() {
            let Some(wire) = wire else {
                eprintln!("{j} none");
                continue;
            };
            eprintln!("  {j} {:.4} sd {:.4}", wire.lay_mm - drawn.wires[j].lay_length_mm, wire.lay_sd_mm);
        }
        let view = ViewLines {
            image: &stretch.views[0].image,
            axis_px: &stretch.views[0].axis_px,
            first_mm: stretch.first_line as f64 * PITCH_MM,
            pitch_mm: PITCH_MM,
        };
        let n = strands;
        let knot_lines = estimates.knot_lines;
        for j in 0..n {
            let middle = stretch.first_line as f64 + (lines as f64 - 1.0) / 2.0;
            let middle_mm = middle * PITCH_MM;
            let seen = StrandPixels::gather(rope, &camera, view, j, |line, out| {
                // strand phases of the aligner
                let _ = knot_lines;
                let x = (stretch.first_line + line) as f64 * PITCH_MM;
                let rate = std::f64::consts::TAU / found.lay_mm;
                for (j, p) in out.iter_mut().enumerate() {
                    *p = found.phase_rad + rate * (x - middle_mm) + j as f64 * rope.strand_step_rad();
                }
            });
            if seen.length_mm() < 60.0 {
                continue;
            }
            let Some(reference) = seen.align_wires((0.8 * wire_lay_mm, 1.2 * wire_lay_mm)) else {
                eprintln!("  {j} ref none");
                continue;
            };
            let step = rope.wire_step_rad();
            let off = |a: f64| a - (a / step).round() * step;
            let truth = drawn.wires[j].phase_rad(rope, 0, middle_mm);
            let fast = estimates.fused.wires[j].map_or(f64::NAN, |w| w.phase_rad);
            eprintln!(
                "  {j} ref {:.4} score {:.3} phase {:.4} fast {:.4}",
                reference.wire.lay_length_mm - drawn.wires[j].lay_length_mm,
                reference.score,
                off(reference.wire.phase_rad(rope, 0, middle_mm) - truth),
                off(fast - truth)
            );
            compared += 1;
        }
    }
    assert!(compared > 0);
}

#[test]
fn six_strands_of_nine_wires_ordinary_lay() {
    check(6, 9, 165.0, -71.0);
}

#[test]
fn eight_strands_of_seven_wires_lang_lay_left_hand() {
    check(8, 7, -165.0, -62.0);
}

#[test]
fn six_strands_of_twelve_wires() {
    check(6, 12, 165.0, -71.0);
}
