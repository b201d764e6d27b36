//! What a whole inspection is made of: decoding, alignment, evidence, scores, tables, one after the other in this process, in metres of
//! rope per second and seconds of processor per metre; then the same whole, with its parts side by side.
//!
//! ```text
//! cargo bench --bench split                     10 m of four views of 480 columns
//! cargo bench --bench split -- --quick          3 m
//! cargo bench --bench split -- RECORDING        a recording of one's own, of which the first half is taken to be intact
//! ```
//!
//! Every part uses all processors. Alignment is that of decoded frames in memory; it comprises the search at the beginning.

use anyhow::Context;
use rayon::prelude::*;
use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::model_file::Model;
use ropescope::pipeline::progress::Quiet;
use ropescope::pipeline::stretches::{STRETCH_LINES, StretchReader};
use ropescope::pipeline::tables::LineValues;
use ropescope::pipeline::{Acquisition, InspectOptions, TrainOptions, TrainingRange, inspect, train};
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use ropescope::vision::aligner::{AlignedStretch, Aligner, AlignerSpec, Stretch};
use ropescope::vision::camera::Camera;
use ropescope::vision::evidence::block_lines;
use ropescope::vision::inspection_model::{AlignedView, Seen, ViewAppearance};
use ropescope::vision::judging::Judging;
use ropescope::vision::margins::{MARGIN_BLOCKS, fill_between};
use ropescope::vision::stretch_scores::{StretchScores, join_views};
use std::path::{Path, PathBuf};
use std::time::Instant;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let quick = arguments.iter().any(|argument| argument == "--quick");
    let data = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("bench-data");
    let folder = match arguments.iter().find(|argument| !argument.starts_with("--")) {
        Some(own) => PathBuf::from(own),
        None => recording(&data, if quick { 3.0 } else { 10.0 })?,
    };
    let (acquisition, frames) = open_folder(&folder)?;
    let out = tempfile::tempdir()?;
    let spec = acquisition.aligner_spec();
    let lines = spec.stretch_lines(STRETCH_LINES / acquisition.reduction as usize);
    let mut reader = StretchReader::new(&frames, spec.width_px, lines, 0..usize::MAX, None)?;
    let metres = reader.lines() as f64 * acquisition.line_pitch_mm / 1000.0;
    let model_path = out.path().join("rope.model");
    let range = TrainingRange {
        name: "intact",
        acquisition: &acquisition,
        source: &frames,
        from_m: None,
        to_m: Some(acquisition.start_m + metres / 2.0),
    };
    train(&[range], TrainOptions::default(), &model_path, &Quiet)?;
    let model = Model::read(&model_path)?;

    println!("{} cores, {metres:.2} m\n", std::thread::available_parallelism().map_or(1, usize::from));
    println!("{:<22} {:>9} {:>9} {:>14}", "part", "seconds", "m/s", "processor s/m");
    let timed = Timed { metres };
    let stretches = timed.run("decoding", || -> anyhow::Result<Vec<Stretch>> {
        let mut stretches = Vec::new();
        while let Some(stretch) = reader.next_stretch()? {
            stretches.push(stretch);
        }
        Ok(stretches)
    })?;
    let (aligned, cameras) = timed.run("alignment", || align(spec, stretches))?;
    let evidence = timed.run("evidence", || evidence(&acquisition, &model, &aligned, &cameras));
    let scores = timed.run("scores", || scores(&acquisition, &model, evidence, &aligned, &cameras));
    timed.run("tables", || write(&aligned, &scores, out.path()))?;

    for (name, model_path, maps) in [
        ("whole, without model", None, false),
        ("whole", Some(model_path.clone()), false),
        ("whole, with maps", Some(model_path), true),
    ] {
        let options = InspectOptions { model_path, maps, ..InspectOptions::default() };
        timed.run(name, || inspect(&acquisition, &frames, &options, &out.path().join("results"), &Quiet))?;
    }
    Ok(())
}

/// Times parts that work on so much rope.
struct Timed {
    metres: f64,
}

impl Timed {
    fn run<T>(&self, name: &str, part: impl FnOnce() -> T) -> T {
        let (begun, spent) = (Instant::now(), processor_seconds());
        let done = part();
        let seconds = begun.elapsed().as_secs_f64();
        let spent = processor_seconds() - spent;
        println!("{name:<22} {seconds:>9.2} {:>9.2} {:>14.3}", self.metres / seconds, spent / self.metres);
        done
    }
}

/// What this process has had of the processors so far, as Linux counts it (in hundredths); 0 elsewhere.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // User and system time are the 14th and 15th field; the second is a name in brackets.
    let ticks = stat.rsplit(')').next().into_iter().flat_map(|rest| rest.split_whitespace().skip(11).take(2));
    ticks.filter_map(|field| field.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn align(spec: AlignerSpec, stretches: Vec<Stretch>) -> anyhow::Result<(Vec<AlignedStretch>, Vec<Camera>)> {
    let mut aligner = Aligner::new(spec);
    let mut aligned: Vec<AlignedStretch> = stretches.into_iter().flat_map(|stretch| aligner.push(stretch)).collect();
    aligned.extend(aligner.finish());
    let cameras = aligner.cameras().context("no rope was found in the recording")?;
    Ok((aligned, cameras))
}

/// Evidence of all factors, `[stretch][view]`.
fn evidence(
    acquisition: &Acquisition,
    model: &Model,
    aligned: &[AlignedStretch],
    cameras: &[Camera],
) -> Vec<Vec<Option<Seen>>> {
    let (rope, pitch_mm) = (&acquisition.rope, acquisition.line_pitch_mm);
    let of_view = |stretch: &AlignedStretch, v: usize| {
        Some(AlignedView::of(rope, stretch, cameras, v, pitch_mm)?.seen_by(&model.views[v], MARGIN_BLOCKS))
    };
    let of_stretch = |stretch| (0..model.views.len()).into_par_iter().map(|v| of_view(stretch, v)).collect();
    let mut evidence: Vec<Vec<Option<Seen>>> = aligned.iter().map(of_stretch).collect();
    for cut in 1..evidence.len() {
        let (before, after) = evidence.split_at_mut(cut);
        fill_between(&mut before[cut - 1], &mut after[0]);
    }
    evidence
}

/// Scores of all stretches, `[stretch][view]`.
fn scores(
    acquisition: &Acquisition,
    model: &Model,
    evidence: Vec<Vec<Option<Seen>>>,
    aligned: &[AlignedStretch],
    cameras: &[Camera],
) -> Vec<Vec<Option<StretchScores>>> {
    let pitch_mm = acquisition.line_pitch_mm;
    let block_mm = block_lines(pitch_mm) as f64 * pitch_mm;
    let of_stretch = |(number, views): (usize, Vec<Option<Seen>>)| {
        let strands = acquisition.rope.strands();
        let beside = [number.checked_sub(1), Some(number), Some(number + 1)].map(|number| aligned.get(number?));
        let of_view = |(v, (seen, model)): (usize, (Option<Seen>, &ViewAppearance))| {
            let image = beside.map(|stretch| AlignedView::of(&acquisition.rope, stretch?, cameras, v, pitch_mm));
            Some(Judging::WHOLE.score(model, (&seen?, image), strands, pitch_mm))
        };
        let views = views.into_par_iter().zip(&model.views).enumerate();
        let mut scored: Vec<Option<StretchScores>> = views.map(of_view).collect();
        join_views(&mut scored, acquisition.rope.strands());
        for scores in scored.iter_mut().flatten() {
            model.lasting.raise(scores, block_mm);
            scores.add_closer_look();
            scores.cut_margins(MARGIN_BLOCKS);
        }
        scored
    };
    evidence.into_iter().enumerate().map(of_stretch).collect()
}

/// Displacement and line scores, as an inspection writes them.
fn write(aligned: &[AlignedStretch], scores: &[Vec<Option<StretchScores>>], folder: &Path) -> anyhow::Result<()> {
    let views = aligned.first().map_or(0, |stretch| stretch.views.len());
    let (mut displacement, mut line_scores) = (LineValues::create(folder, views)?, LineValues::create(folder, views)?);
    for (stretch, scores) in aligned.iter().zip(scores) {
        for (v, (view, scores)) in stretch.views.iter().zip(scores).enumerate() {
            displacement.append(v, view.axis_px.iter().copied())?;
            let of_line = |k: usize| scores.as_ref().map_or(f32::NAN, |s| s.blocks[k / s.block_lines]);
            line_scores.append(v, (0..stretch.lines).map(of_line))?;
        }
    }
    displacement.write_csv("displacement.csv", "view,line,displacement_px", true, 3)?;
    line_scores.write_csv("line_scores.csv", "view,line,score", false, 4)?;
    Ok(())
}

/// Simulates a recording, or finds it from an earlier run.
fn recording(data: &Path, metres: f64) -> anyhow::Result<PathBuf> {
    let folder = data.join(format!("split-{metres}m"));
    if !folder.is_dir() {
        println!("simulating {metres} m of rope, once");
        let partial = folder.with_extension("partial");
        if partial.exists() {
            std::fs::remove_dir_all(&partial)?;
        }
        let recipe = Recipe { metres, defects: metres as usize / 2, ..Recipe::photographic() };
        write_acquisition(&Scene::new(&recipe, 3)?, &partial, |_| {})?;
        std::fs::rename(&partial, &folder)?;
    }
    Ok(folder)
}
