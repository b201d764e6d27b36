//! Writes what the networks of the closer look learn from: patches or details of all suspects of a recording, in its order.
//!
//! ```text
//! cargo run --release --example patches -- patches|details RECORDING MODEL OUT
//! ```
//!
//! Every one is a row of little-endian f32: view, line, column, score, logarithm of the odds by the network of patches, then its values
//! (`vision::patch`, `vision::detail`). Whether it shows damage say the labels of the recording, see `training/fit_patches.py` and
//! `training/fit_details.py`. Details are written where that network is in some doubt.

use anyhow::{Context, bail};
use ropescope::pipeline::acquisition::{Acquisition, open_folder};
use ropescope::pipeline::model_file::Model;
use ropescope::pipeline::stretches::{STRETCH_LINES, StretchReader};
use ropescope::vision::aligner::{AlignedStretch, Aligner};
use ropescope::vision::camera::Camera;
use ropescope::vision::closer_look::{Suspect, suspects};
use ropescope::vision::damage::Network;
use ropescope::vision::detail::Details;
use ropescope::vision::inspection_model::{AlignedView, Seen};
use ropescope::vision::margins::{MARGIN_BLOCKS, fill_between};
use ropescope::vision::patch::Patch;
use ropescope::vision::surface_map::PLACES_PER_WIRE;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Logarithm of odds from which on details are written: some doubt more than inspections have.
const LEAST_LOG_ODDS: f32 = -5.0;

/// Rows and columns of details: more than the network looks at, so that there is something to shift in.
const DETAIL_SIDE: usize = 64;

/// What is written.
#[derive(Clone, Copy, PartialEq)]
enum What {
    Patches,
    Details,
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, recording, model, out] = &arguments[..] else {
        bail!("usage: patches patches|details RECORDING MODEL OUT")
    };
    let what = match what.as_str() {
        "patches" => What::Patches,
        "details" => What::Details,
        other => bail!("{other}: either patches or details"),
    };
    let (acquisition, frames) = open_folder(Path::new(recording))?;
    let model = Model::read(Path::new(model))?;
    let mut out = BufWriter::new(File::create(out).with_context(|| out.clone())?);
    let spec = acquisition.aligner_spec();
    let lines = spec.stretch_lines(STRETCH_LINES);
    let mut reader = StretchReader::new(&frames, spec.width_px, lines, 0..usize::MAX, None)?;
    let mut aligner = Aligner::new(spec);
    let (rope, pitch_mm) = (&acquisition.rope, acquisition.line_pitch_mm);
    // The last three stretches; what was seen of the one before the last is whole when the last one is there.
    let mut last: VecDeque<(AlignedStretch, Vec<Option<Seen>>)> = VecDeque::new();
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
            if let Some((_, before)) = last.back_mut() {
                fill_between(before, &mut seen);
            }
            last.push_back((stretch, seen));
            if last.len() >= 2 {
                write(&mut out, what, (&acquisition, &cameras, &model), &last, last.len() - 2)?;
            }
            if last.len() == 3 {
                last.pop_front();
            }
        }
        if ended {
            if !last.is_empty() {
                write(&mut out, what, (&acquisition, &cameras, &model), &last, last.len() - 1)?;
            }
            return Ok(out.flush()?);
        }
    }
}

/// Writes those of a stretch.
fn write(
    out: &mut impl Write,
    what: What,
    (acquisition, cameras, model): (&Acquisition, &[Camera], &Model),
    stretches: &VecDeque<(AlignedStretch, Vec<Option<Seen>>)>,
    which: usize,
) -> std::io::Result<()> {
    let (strands, pitch_mm) = (acquisition.rope.strands(), acquisition.line_pitch_mm);
    let (stretch, seen) = &stretches[which];
    for (v, (seen, model)) in seen.iter().zip(&model.views).enumerate() {
        let (Some(seen), Some(aligned)) = (seen, AlignedView::of(&acquisition.rope, stretch, cameras, v, pitch_mm))
        else {
            continue;
        };
        let at = |number: Option<usize>| {
            AlignedView::of(&acquisition.rope, &stretches.get(number?)?.0, cameras, v, pitch_mm)
        };
        let beside = [at(which.checked_sub(1)), Some(aligned), at(Some(which + 1))];
        let scores = model.score(&seen.evidence, pitch_mm);
        let (mut patch, mut map) = (Patch::default(), aligned.surface_map());
        let (network, mut details) = (Network::trained(), Details::new(beside, &model.gray, DETAIL_SIDE));
        for Suspect { block, strand, place, score, .. } in suspects(&scores, strands, MARGIN_BLOCKS) {
            let first = (block - MARGIN_BLOCKS) * aligned.block_lines;
            let line = (first + aligned.block_lines / 2).min(aligned.view.image.lines() - 1);
            let (mut columns, mut pixels) = (0.0, 0.0);
            map.for_each(line, aligned.view.axis_px[line], |point| {
                if (point.strand, point.place) == (strand, place) {
                    (columns, pixels) = (columns + point.column as f32, pixels + 1.0);
                }
            });
            patch.cut(&seen.unrolled, &seen.evidence, block, strand, place / PLACES_PER_WIRE);
            let log_odds = network.look(&patch, score).log_odds;
            let detail = if what == What::Details { details.about(block - MARGIN_BLOCKS, strand, place) } else { None };
            let values = match what {
                What::Patches => patch.values(),
                What::Details => match detail.filter(|_| log_odds >= LEAST_LOG_ODDS) {
                    Some(detail) => detail,
                    None => continue,
                },
            };
            let head = [v as f32, (stretch.first_line + line) as f32, columns / pixels, score, log_odds];
            for value in head.iter().chain(values) {
                out.write_all(&value.to_le_bytes())?;
            }
        }
    }
    Ok(())
}
