//! Single stages of the vision pipeline on one simulated stretch (one view, 480 columns), in lines per second:
//! contours, registration of the strands, stripes of the wires, learning, evidence of anomalies.
//!
//! `cargo bench --bench stages`; the whole way, from files to results, is what `whole_process` times.

#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ropescope::simulate::{Recipe, Scene, render_view_frame};
use ropescope::vision::aligner::{AlignedStretch, Aligner, AlignerSpec, GATHERED, Stretch};
use ropescope::vision::appearance::Appearance;
use ropescope::vision::bandwidths::Bandwidths;
use ropescope::vision::camera::Camera;
use ropescope::vision::contour::extract;
use ropescope::vision::estimates::Estimates;
use ropescope::vision::evidence::{block_lines, learn};
use ropescope::vision::histogram::Histogram;
use ropescope::vision::image::GrayImage;
use ropescope::vision::registration::{Knots, register};
use ropescope::vision::residuals::{Judged, Residuals};
use ropescope::vision::shade::Shade;
use ropescope::vision::surface::Outlines;
use ropescope::vision::template::{Template, TemplateSums};
use ropescope::vision::unwrapping::{FARTHEST_RAD, StripeTable, read_stripes};
use std::hint::black_box;

/// Lines of the stretch that is timed.
const LINES: usize = 2000;

/// A stretch whose alignment is known, as the pipeline has it.
struct Known {
    spec: AlignerSpec,
    stretch: AlignedStretch,
    estimates: Estimates,
    camera: Camera,
    template: Template,
}

impl Known {
    fn new() -> Self {
        let recipe = Recipe {
            metres: GATHERED as f64 * LINES as f64 * 1e-4,
            frame_lines: LINES,
            view_angles_deg: vec![0.0],
            ..Recipe::photographic()
        };
        let scene = Scene::new(&recipe, 11).expect("the recipe is the usual one");
        let width = recipe.sensor_px as usize;
        let angles = vec![scene.view_angle_rad(0)];
        let spec =
            AlignerSpec::new(scene.rope().clone(), recipe.line_pitch_mm, angles, width, Some(recipe.rope_width_px));
        let mut aligner = Aligner::new(spec.clone());
        let mut aligned = Vec::new();
        for frame in 0..scene.frames() {
            let image = GrayImage::new(width, render_view_frame(&scene, 0, frame)).expect("frames are whole lines");
            let (first_line, lines) = (scene.first_line(frame), image.lines());
            aligned.extend(aligner.push(Stretch { first_line, lines, images: vec![image], given_contours: None }));
        }
        aligned.extend(aligner.finish());
        let camera = aligner.cameras().expect("simulated rope is found")[0];
        let stretch = aligned.swap_remove(GATHERED / 2);
        let estimates = stretch.estimates.clone().expect("simulated rope is aligned");
        let mut sums = TemplateSums::new(width);
        let view = &stretch.views[0];
        let phases = phases(&estimates, spec.rope.strands());
        sums.add(
            &spec.rope,
            &view.image,
            &view.axis_px,
            1,
            |line| {
                let mut out = vec![0.0; spec.rope.strands()];
                phases(line, &mut out);
                camera.phase_in_view(out[0])
            },
            |_, _, _| (),
        );
        let template = Template::new(&spec.rope, &camera, &sums).expect("a stretch is enough for a template");
        Self { spec, stretch, estimates, camera, template }
    }
}

/// Phases of all strands at a line: those of its knot.
fn phases(estimates: &Estimates, strands: usize) -> impl Fn(usize, &mut [f64]) + Copy + '_ {
    move |line, out| {
        let knot = (line / estimates.knot_lines).min(estimates.strand_phases_rad.len() / strands - 1);
        out.copy_from_slice(&estimates.strand_phases_rad[knot * strands..(knot + 1) * strands]);
    }
}

fn stages(criterion: &mut Criterion) {
    let known = Known::new();
    let (rope, camera, estimates) = (&known.spec.rope, &known.camera, &known.estimates);
    let (view, template) = (&known.stretch.views[0], &known.template);
    let mut histogram = Histogram::default();
    let block_lines = block_lines(known.spec.pitch_mm);
    learn(rope, camera, estimates, view, block_lines, &mut histogram);
    let appearance = Appearance::learn(&histogram, Bandwidths::FIXED);
    let phases = phases(estimates, rope.strands());
    let unknown_wires = |_: usize, out: &mut [f64]| out.fill(f64::NAN);
    let table = StripeTable::new(rope.wires(), known.spec.reading_lines);
    let outlines = Outlines::new(rope, camera);
    let shade = Shade::new(rope, template, None, FARTHEST_RAD);

    let mut group = criterion.benchmark_group("stages");
    group.throughput(Throughput::Elements(view.image.lines() as u64)).sample_size(20);
    group.bench_function("contours", |b| {
        b.iter(|| extract(black_box(&view.image), &view.lost, known.spec.rope_width_px))
    });
    group.bench_function("registration", |b| {
        b.iter(|| {
            let (image, axis) = (black_box(&view.image), &view.axis_px);
            let knots = Knots { lines: known.spec.knot_lines, thinned: 1 };
            register(rope, template, None, camera.angle_rad, image, axis, knots, phases, unknown_wires)
        });
    });
    group.bench_function("stripes", |b| {
        b.iter(|| read_stripes(rope, &outlines, &shade, &table, black_box(&view.image), &view.axis_px, phases));
    });
    group.bench_function("learning", |b| {
        b.iter(|| learn(rope, camera, estimates, black_box(view), block_lines, &mut histogram));
    });
    group.bench_function("evidence", |b| {
        b.iter(|| {
            let gray = (&appearance, Judged::Nothing);
            Residuals::gather(rope, camera, estimates, black_box(view), gray, (block_lines, 0), known.spec.pitch_mm)
        });
    });
    group.finish();
}

criterion_group!(benches, stages);
criterion_main!(benches);
