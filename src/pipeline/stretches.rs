//! Cuts the frames of an acquisition into stretches of equal lines, all views side by side; one frame a view in memory.

use super::source::{Frame, FrameSource, SourceError};
use crate::vision::aligner::Stretch;
use crate::vision::contour::Contours;
use crate::vision::image::GrayImage;
use rayon::prelude::*;

/// Lines of a stretch, about: long enough for a lay length, short enough to keep a few in memory.
pub const STRETCH_LINES: usize = 2000;

struct ViewReader {
    view: usize,
    /// First line of every frame, and the end.
    starts: Vec<usize>,
    current: Option<(usize, Frame)>,
}

impl ViewReader {
    /// Lines `from..to` of the view; without lines if the view has none of them, black where it ends inside.
    fn read(
        &mut self,
        source: &dyn FrameSource,
        width: usize,
        from: usize,
        to: usize,
    ) -> Result<GrayImage, SourceError> {
        let end = self.starts[self.starts.len() - 1];
        if from >= end {
            return Ok(GrayImage::default());
        }
        let mut image = GrayImage::black(width, to - from);
        let mut line = from;
        while line < to.min(end) {
            let frame = self.starts.partition_point(|&start| start <= line) - 1;
            if self.current.as_ref().is_none_or(|(n, _)| *n != frame) {
                self.current = Some((frame, source.load(self.view, frame)?));
            }
            let Some((_, loaded)) = &self.current else { break };
            let offset = line - self.starts[frame];
            let lines = (loaded.lines - offset).min(to.min(end) - line);
            for k in 0..lines {
                let row = (offset + k) * loaded.width;
                image.line_mut(line - from + k).copy_from_slice(&loaded.pixels[row..row + width]);
            }
            line += lines;
        }
        Ok(image)
    }
}

/// Reads an acquisition stretch by stretch.
pub struct StretchReader<'a> {
    source: &'a dyn FrameSource,
    width: usize,
    stretch_lines: usize,
    next_line: usize,
    end_line: usize,
    lines: usize,
    readers: Vec<ViewReader>,
    given_contours: Option<&'a [Vec<(f32, f32)>]>,
}

impl<'a> StretchReader<'a> {
    /// Reads `from_line..to_line` (cut to what there is) in stretches of `stretch_lines`.
    pub fn new(
        source: &'a dyn FrameSource,
        width: usize,
        stretch_lines: usize,
        range: std::ops::Range<usize>,
        given_contours: Option<&'a [Vec<(f32, f32)>]>,
    ) -> Result<Self, SourceError> {
        let mut readers = Vec::new();
        for view in 0..source.views() {
            let mut starts = vec![0];
            for frame in 0..source.frames(view) {
                starts.push(starts[frame] + source.lines(view, frame)?);
            }
            readers.push(ViewReader { view, starts, current: None });
        }
        let lines = readers.iter().map(|r| r.starts[r.starts.len() - 1]).max().unwrap_or(0);
        let end_line = range.end.min(lines);
        Ok(Self {
            source,
            width,
            stretch_lines,
            next_line: range.start.min(end_line),
            end_line,
            lines,
            readers,
            given_contours,
        })
    }

    /// Lines of the longest view.
    pub fn lines(&self) -> usize {
        self.lines
    }

    /// Lines that are read in all.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.next_line..self.end_line
    }

    /// Lines of every frame of a view.
    pub fn frame_lines(&self, view: usize) -> Vec<usize> {
        self.readers[view].starts.windows(2).map(|w| w[1] - w[0]).collect()
    }

    /// The next stretch; `None` at the end. A short rest is joined to the last stretch.
    pub fn next_stretch(&mut self) -> Result<Option<Stretch>, SourceError> {
        if self.next_line >= self.end_line {
            return Ok(None);
        }
        let from = self.next_line;
        let mut to = (from + self.stretch_lines).min(self.end_line);
        if self.end_line - to < self.stretch_lines / 2 {
            to = self.end_line;
        }
        self.next_line = to;
        let (source, width) = (self.source, self.width);
        let images = self
            .readers
            .par_iter_mut()
            .map(|reader| reader.read(source, width, from, to))
            .collect::<Result<Vec<_>, _>>()?;
        let given_contours = self.given_contours.map(|views| {
            views
                .iter()
                .map(|view| {
                    let line = |k: usize| view.get(k).copied().unwrap_or((f32::NAN, f32::NAN));
                    Contours {
                        lower_px: (from..to).map(|k| line(k).0).collect(),
                        upper_px: (from..to).map(|k| line(k).1).collect(),
                    }
                })
                .collect()
        });
        Ok(Some(Stretch { first_line: from, lines: to - from, images, given_contours }))
    }
}
