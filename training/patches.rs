//! Writes what the network of the closer look learns from: the patches of all suspects of a recording, in its order.
//!
//! ```text
//! cargo run --release --example patches -- RECORDING MODEL OUT
//! ```
//!
//! Every patch is a row of little-endian f32: view, line, column, score, then its values (`vision::patch`). Whether it shows damage
//! say the labels of the recording, see `training/fit.py`.

use anyhow::{Context, ensure};
use ropescope::pipeline::acquisition::{Acquisition, open_folder};
use ropescope::pipeline::model_file::Model;
use ropescope::pipeline::stretches::{STRETCH_LINES, StretchReader};
use ropescope::vision::aligner::{AlignedStretch, Aligner};
use ropescope::vision::camera::Camera;
use ropescope::vision::closer_look::{Suspect, suspects};
use ropescope::vision::inspection_model::{AlignedView, Seen};
use ropescope::vision::margins::{MARGIN_BLOCKS, fill_between};
use ropescope::vision::patch::Patch;
use ropescope::vision::surface_map::PLACES_PER_WIRE;
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
    let (rope, pitch_mm) = (&acquisition.rope, acquisition.line_pitch_mm);
    let mut waiting: Option<(AlignedStretch, Vec<Option<Seen>>)> = None;
    loop {
        let next = reader.next_stretch()?;
        let ended = next.is_none();
        let aligned: Vec<AlignedStretch> = match next {
            Some(stretch) => aligner.push(stretch),
            None => aligner.finish(),
        };
        let cameras = aligner.cameras().unwrap_or_default();
        for stretch in aligned {
            let view = |(v, model)| {
                Some(AlignedView::of(rope, &stretch, &cameras, v, pitch_mm)?.seen_by(model, MARGIN_BLOCKS))
            };
            let mut seen: Vec<Option<Seen>> = model.views.iter().enumerate().map(view).collect();
            if let Some((before, mut seen_before)) = waiting.take() {
                fill_between(&mut seen_before, &mut seen);
                write(&mut out, &acquisition, &cameras, &model, (&before, &seen_before))?;
            }
            waiting = Some((stretch, seen));
        }
        if ended {
            if let Some((last, seen)) = &waiting {
                write(&mut out, &acquisition, &cameras, &model, (last, seen))?;
            }
            return Ok(out.flush()?);
        }
    }
}

/// Writes the patches of a stretch.
fn write(
    out: &mut impl Write,
    acquisition: &Acquisition,
    cameras: &[Camera],
    model: &Model,
    (stretch, seen): (&AlignedStretch, &[Option<Seen>]),
) -> std::io::Result<()> {
    let (strands, pitch_mm) = (acquisition.rope.strands(), acquisition.line_pitch_mm);
    for (v, (seen, model)) in seen.iter().zip(&model.views).enumerate() {
        let (Some(seen), Some(aligned)) = (seen, AlignedView::of(&acquisition.rope, stretch, cameras, v, pitch_mm))
        else {
            continue;
        };
        let scores = model.score(&seen.evidence, pitch_mm);
        let (mut patch, mut map) = (Patch::default(), aligned.surface_map());
        for Suspect { block, strand, place, score, .. } in suspects(&scores, strands, MARGIN_BLOCKS) {
            let first = (block - MARGIN_BLOCKS) * aligned.block_lines;
            let line = (first + aligned.block_lines / 2).min(aligned.view.image.lines() - 1);
            let (mut columns, mut pixels) = (0.0, 0.0);
            map.for_each(line, aligned.view.axis_px[line], |point| {
                if (point.strand, point.place) == (strand, place) {
                    (columns, pixels) = (columns + point.column as f32, pixels + 1.0);
                }
            });
            patch.cut(&seen.unrolled, &seen.evidence[1..], block, strand, place / PLACES_PER_WIRE);
            let head = [v as f32, (stretch.first_line + line) as f32, columns / pixels, score];
            for value in head.iter().chain(patch.values()) {
                out.write_all(&value.to_le_bytes())?;
            }
        }
    }
    Ok(())
}
