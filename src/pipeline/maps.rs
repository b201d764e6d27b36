//! Writes likelihood maps as images of the same geometry as the frames, while stretches go by.

use super::likelihood_map::LikelihoodMap;
use super::tables::write_error;
use super::{FrameSource, PipelineError};
use rayon::prelude::*;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

struct ViewMaps {
    view: usize,
    folder: PathBuf,
    width: usize,
    frame: usize,
    pixels: Vec<[u8; 2]>,
}

/// `maps/view{v}/frame_{n:06}.png`, 8-bit gray and alpha.
pub(super) struct MapWriter<'a> {
    source: &'a dyn FrameSource,
    views: Vec<ViewMaps>,
}

impl<'a> MapWriter<'a> {
    /// The frames of `source` give the heights; those that a stretch was read from are known by then.
    pub fn new(folder: PathBuf, width: usize, source: &'a dyn FrameSource) -> Self {
        let view = |view| {
            let folder = folder.join(format!("view{view}"));
            ViewMaps { view, folder, width, frame: 0, pixels: Vec::new() }
        };
        Self { source, views: (0..source.views()).map(view).collect() }
    }

    /// Appends the maps of a stretch, one a view; writes the frames that became whole.
    pub fn append(&mut self, maps: Vec<LikelihoodMap>) -> Result<(), PipelineError> {
        let source = self.source;
        self.views.par_iter_mut().zip(maps).try_for_each(|(view, map)| {
            view.pixels.extend(map.pixels);
            view.write_whole_frames(source)
        })
    }

    /// Writes what is left: an acquisition whose views end at different lines has been padded.
    pub fn finish(mut self) -> Result<(), PipelineError> {
        self.views.iter_mut().try_for_each(|view| view.write_whole_frames(self.source))
    }
}

impl ViewMaps {
    fn write_whole_frames(&mut self, source: &dyn FrameSource) -> Result<(), PipelineError> {
        while !self.pixels.is_empty() && self.frame < source.frames(self.view) {
            let lines = source.lines(self.view, self.frame)?;
            if self.pixels.len() < lines * self.width {
                return Ok(());
            }
            std::fs::create_dir_all(&self.folder).map_err(write_error(&self.folder))?;
            let path = self.folder.join(format!("frame_{:06}.png", self.frame));
            write_png(&path, self.width, lines, &self.pixels[..lines * self.width])?;
            self.pixels.drain(..lines * self.width);
            self.frame += 1;
        }
        Ok(())
    }
}

fn write_png(path: &Path, width: usize, lines: usize, pixels: &[[u8; 2]]) -> Result<(), PipelineError> {
    let file = BufWriter::new(File::create(path).map_err(write_error(path))?);
    let mut encoder = png::Encoder::new(file, width as u32, lines as u32);
    encoder.set_color(png::ColorType::GrayscaleAlpha);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(|e| write_error(path)(e.into()))?;
    writer.write_image_data(pixels.as_flattened()).map_err(|e| write_error(path)(e.into()))?;
    writer.finish().map_err(|e| write_error(path)(e.into()))
}
