//! Writes a scene as an acquisition folder with its truth.

use super::labels::{Label, labels};
use super::recipe::Kind;
use super::scene::Scene;
use super::{render_view_frame, truth};
use crate::pipeline::acquisition::{RopeFile, ViewFile};
use rayon::prelude::*;
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// How far the writing is. All views count: `view_lines_total` is lines times views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RenderProgress {
    /// Lines written so far, over all views.
    pub view_lines_done: usize,
    /// Lines to write, over all views.
    pub view_lines_total: usize,
}

/// Why an acquisition could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// A file or folder could not be written.
    #[error("cannot write {path}: {source}; check the folder's permissions and the free space")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
}

/// `rope.json` with the keys that only a finished acquisition has.
#[derive(Serialize)]
struct WrittenRope {
    #[serde(flatten)]
    rope: RopeFile,
    lines: usize,
    frames: usize,
    frame_lines: usize,
    seed: u64,
    kind: &'static str,
}

/// What `rope.json` says of a scene: its nominal values, not the true ones.
pub fn rope_file(scene: &Scene) -> RopeFile {
    let recipe = scene.recipe();
    let views = recipe.view_angles_deg.iter().enumerate();
    let px_per_mm = recipe.calibrated.then(|| scene.camera().focal_px / scene.camera().distance_mm);
    RopeFile {
        strands: recipe.strands,
        wires_per_strand: recipe.wires_per_strand,
        rope_diameter_mm: recipe.diameter_mm,
        strand_lay_mm: Some(recipe.strand_lay_mm),
        wire_lay_mm: Some(recipe.wire_lay_mm),
        strand_diameter_mm: None,
        wire_diameter_mm: None,
        line_pitch_mm: recipe.line_pitch_mm,
        rope_width_px: Some(recipe.rope_width_px),
        sensor_px: recipe.sensor_px,
        views: views.map(|(v, &angle_deg)| ViewFile { folder: format!("view{v}"), angle_deg, px_per_mm }).collect(),
        start_m: Some(recipe.start_m),
        ropeway: None,
        rope: None,
        acquired_at: None,
    }
}

/// Writes frames, `rope.json`, `labels.json` and the truth tables into `folder`, which is created if needed.
///
/// Memory stays at a few frames. `progress` is called after every frame, from several threads.
pub fn write_acquisition(
    scene: &Scene,
    folder: &Path,
    progress: impl Fn(RenderProgress) + Sync,
) -> Result<Vec<Label>, SimulateError> {
    for view in 0..scene.views() {
        let path = folder.join(format!("view{view}"));
        std::fs::create_dir_all(&path).map_err(|source| SimulateError::Write { path, source })?;
    }
    let recipe = scene.recipe();
    let labels = write_description(scene, folder)?;
    put(&folder.join("truth_lines.csv"), |out| truth::write_lines(scene, out))?;
    put(&folder.join("truth_wires.csv"), |out| truth::write_wires(scene, out))?;
    if recipe.kind == Kind::Artificial {
        for view in 0..scene.views() {
            put(&folder.join(format!("contours{view}.csv")), |out| truth::write_contours(scene, view, out))?;
        }
    }
    let (done, total) = (AtomicUsize::new(0), scene.lines() * scene.views());
    (0..scene.frames() * scene.views()).into_par_iter().try_for_each(|job| {
        let (frame, view) = (job / scene.views(), job % scene.views());
        let height = scene.frame_height(frame);
        let pixels = render_view_frame(scene, view, frame);
        put(&folder.join(format!("view{view}/frame_{frame:06}.png")), |out| {
            out.write_all(&encode_png(recipe.sensor_px, height as u32, &pixels)?)
        })?;
        let view_lines_done = done.fetch_add(height, Ordering::Relaxed) + height;
        progress(RenderProgress { view_lines_done, view_lines_total: total });
        Ok(())
    })?;
    Ok(labels)
}

/// Writes `rope.json` and `labels.json` alone, without frames, into a folder that exists.
pub fn write_description(scene: &Scene, folder: &Path) -> Result<Vec<Label>, SimulateError> {
    let recipe = scene.recipe();
    let written = WrittenRope {
        rope: rope_file(scene),
        lines: scene.lines(),
        frames: scene.frames(),
        frame_lines: recipe.frame_lines,
        seed: scene.seed(),
        kind: match recipe.kind {
            Kind::Artificial => "artificial",
            Kind::Photographic => "photographic",
        },
    };
    let labels = labels(scene);
    put(&folder.join("rope.json"), |out| Ok(serde_json::to_writer_pretty(out, &written)?))?;
    put(&folder.join("labels.json"), |out| Ok(serde_json::to_writer_pretty(out, &labels)?))?;
    Ok(labels)
}

/// A frame as an 8-bit gray PNG, compressed for speed.
pub fn encode_png(width: u32, height: u32, pixels: &[u8]) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(pixels.len());
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(bytes)
}

fn put(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<(), SimulateError> {
    let written = File::create(path).and_then(|file| {
        let mut out = BufWriter::with_capacity(1 << 16, file);
        fill(&mut out)?;
        out.flush()
    });
    written.map_err(|source| SimulateError::Write { path: path.into(), source })
}
