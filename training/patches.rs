//! Writes what the network of the closer look learns from: the patches of all suspects of a recording, in its order.
//!
//! ```text
//! cargo run --release --example patches -- RECORDING MODEL OUT
//! ```
//!
//! Every patch is a row of little-endian f32: view, line, column, score, then its values (`vision::patch`). Whether it shows damage
//! say the labels of the recording, see `training/fit.py`.

use anyhow::{Context, ensure};
use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::model_file::Model;
use ropescope::pipeline::stretches::{STRETCH_LINES, StretchReader};
use ropescope::vision::aligner::{AlignedStretch, Aligner};
use ropescope::vision::camera::Camera;
use ropescope::vision::closer_look::{Suspect, suspects};
use ropescope::vision::evidence::block_lines;
use ropescope::vision::inspection_model::{AlignedView, ViewAppearance};
use ropescope::vision::patch::Patch;
use ropescope::vision::rope::Rope;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    ensure!(arguments.len() == 3, "usage: patches RECORDING MODEL OUT");
    let (acquisition, frames) = open_folder(Path::new(&arguments[0]))?;
    let model = Model::read(Path::new(&arguments[1]))?;
    let mut out = BufWriter::new(File::create(&arguments[2]).with_context(|| arguments[2].clone())?);
    let spec = acquisition.aligner_spec();
    let lines = spec.stretch_lines(STRETCH_LINES);
    let mut reader = StretchReader::new(&frames, spec.width_px, lines, 0..usize::MAX, None)?;
    let mut aligner = Aligner::new(spec);
    let pitch_mm = acquisition.line_pitch_mm;
    loop {
        let next = reader.next_stretch()?;
        let ended = next.is_none();
        let aligned: Vec<AlignedStretch> = match next {
            Some(stretch) => aligner.push(stretch),
            None => aligner.finish(),
        };
        for stretch in &aligned {
            let cameras = aligner.cameras().context("no rope was found in the recording")?;
            for (v, view) in model.views.iter().enumerate() {
                write_view(&mut out, &acquisition.rope, pitch_mm, (stretch, v), &cameras[v], view)?;
            }
        }
        if ended {
            return Ok(out.flush()?);
        }
    }
}

/// Writes the patches of one view of a stretch.
fn write_view(
    out: &mut impl Write,
    rope: &Rope,
    pitch_mm: f64,
    (stretch, v): (&AlignedStretch, usize),
    camera: &Camera,
    model: &ViewAppearance,
) -> std::io::Result<()> {
    let view = &stretch.views[v];
    let (Ok(estimates), true) = (&stretch.estimates, view.usable()) else { return Ok(()) };
    let block_lines = block_lines(pitch_mm);
    let aligned = AlignedView { rope, camera, estimates, view, block_lines, pitch_mm };
    let seen = aligned.seen_by(model, 0);
    let scores = model.score(&seen.evidence, pitch_mm);
    let (mut patch, mut map) = (Patch::default(), aligned.surface_map());
    for suspect in suspects(&scores, rope.strands(), 0) {
        let Suspect { block, strand, place, score, .. } = suspect;
        let line = (block * block_lines + block_lines / 2).min(view.image.lines() - 1);
        let (mut columns, mut pixels) = (0.0, 0.0);
        map.for_each(line, view.axis_px[line], |point| {
            if (point.strand, point.place) == (strand, place) {
                (columns, pixels) = (columns + point.column as f32, pixels + 1.0);
            }
        });
        patch.cut(&seen.unrolled, &seen.evidence[1..], block, strand, suspect.wire());
        let head = [v as f32, (stretch.first_line + line) as f32, columns / pixels, score];
        for value in head.iter().chain(patch.values()) {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    Ok(())
}
