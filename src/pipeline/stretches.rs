//! Cuts the frames of an acquisition into stretches of equal lines, all views side by side; one frame a view in memory.

use super::source::{Frame, FrameSource, SourceError};
use crate::vision::aligner::Stretch;
use crate::vision::contour::Contours;
use crate::vision::image::GrayImage;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Lines of a stretch, about: long enough for a lay length, short enough to keep a few in memory.
pub const STRETCH_LINES: usize = 2000;

struct ViewReader {
    view: usize,
    /// First line of every frame that is known, and the end of the last.
    starts: Vec<usize>,
    /// No more frames follow.
    ended: bool,
    current: Option<(usize, Frame)>,
}

impl ViewReader {
    /// Lines that are known to be there.
    fn lines(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    /// Goes on until line `to` is known to be there, or the end; waits where the source still grows.
    fn reach(&mut self, source: &dyn FrameSource, to: usize) -> Result<(), SourceError> {
        while !self.ended && self.lines() < to {
            let frame = self.starts.len() - 1;
            if source.wait_for(self.view, frame)? {
                self.starts.push(self.lines() + source.lines(self.view, frame)?);
            } else {
                self.ended = true;
            }
        }
        Ok(())
    }

    /// Lines `from..to` of the view, as many as it has.
    fn read(
        &mut self,
        source: &dyn FrameSource,
        width: usize,
        from: usize,
        to: usize,
    ) -> Result<GrayImage, SourceError> {
        let end = self.lines();
        if from >= end {
            return Ok(GrayImage::default());
        }
        let mut pixels = Vec::with_capacity((to - from) * width);
        let mut line = from;
        while line < to.min(end) {
            let frame = self.starts.partition_point(|&start| start <= line) - 1;
            if self.current.as_ref().is_none_or(|(n, _)| *n != frame) {
                self.current = Some((frame, source.load(self.view, frame)?));
            }
            let Some((_, loaded)) = &self.current else { break };
            let offset = line - self.starts[frame];
            let lines = (loaded.lines - offset).min(to.min(end) - line);
            pixels.extend_from_slice(&loaded.pixels[offset * width..(offset + lines) * width]);
            line += lines;
        }
        Ok(GrayImage::new(width, pixels).expect("frames are whole lines"))
    }
}

/// Reads an acquisition stretch by stretch.
pub struct StretchReader<'a> {
    source: &'a dyn FrameSource,
    width: usize,
    stretch_lines: usize,
    next_line: usize,
    /// Where to end at the latest.
    to_line: usize,
    waited: Duration,
    readers: Vec<ViewReader>,
    given_contours: Option<&'a [Vec<(f32, f32)>]>,
}

impl<'a> StretchReader<'a> {
    /// Reads `range` (cut to what there is) in stretches of `stretch_lines`.
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
            readers.push(ViewReader { view, starts, ended: false, current: None });
        }
        Ok(Self {
            source,
            width,
            stretch_lines,
            next_line: range.start,
            to_line: range.end,
            waited: Duration::ZERO,
            readers,
            given_contours,
        })
    }

    /// Lines of the longest view, as far as they are known.
    pub fn lines(&self) -> usize {
        self.readers.iter().map(ViewReader::lines).max().unwrap_or(0)
    }

    /// Lines that are still to be read, as far as they are known.
    pub fn range(&self) -> std::ops::Range<usize> {
        let end = self.to_line.min(self.lines());
        self.next_line.min(end)..end
    }

    /// How far views must be known for the next stretch to be cut: a short rest is joined to the last stretch.
    fn sight(&self) -> usize {
        self.next_line.saturating_add(self.stretch_lines + self.stretch_lines / 2).min(self.to_line)
    }

    /// True if the next stretch can be had without waiting.
    pub fn is_there(&self) -> bool {
        self.readers.iter().all(|reader| reader.ended || reader.lines() >= self.sight())
    }

    /// Time that was spent waiting for frames.
    pub fn waited(&self) -> Duration {
        self.waited
    }

    /// The next stretch; `None` at the end. A short rest is joined to the last stretch, so every view is awaited for half a
    /// stretch more: the cuts do not depend on when frames came.
    pub fn next_stretch(&mut self) -> Result<Option<Stretch>, SourceError> {
        let from = self.next_line;
        let sight = self.sight();
        let began = Instant::now();
        for reader in &mut self.readers {
            reader.reach(self.source, sight)?;
        }
        self.waited += began.elapsed();
        let end_line = self.range().end;
        if from >= end_line {
            return Ok(None);
        }
        let mut to = (from + self.stretch_lines).min(end_line);
        if end_line - to < self.stretch_lines / 2 {
            to = end_line;
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// `lines[view][frame]`; frames become known one by one, as they are waited for.
    struct Arriving {
        lines: Vec<Vec<usize>>,
        known: Vec<AtomicUsize>,
    }

    impl Arriving {
        fn new(lines: &[Vec<usize>], known: usize) -> Self {
            Self { lines: lines.to_vec(), known: lines.iter().map(|v| AtomicUsize::new(known.min(v.len()))).collect() }
        }
    }

    impl FrameSource for Arriving {
        fn views(&self) -> usize {
            self.lines.len()
        }

        fn frames(&self, view: usize) -> usize {
            self.known[view].load(Ordering::SeqCst)
        }

        fn wait_for(&self, view: usize, frame: usize) -> Result<bool, SourceError> {
            self.known[view].fetch_max((frame + 1).min(self.lines[view].len()), Ordering::SeqCst);
            Ok(frame < self.lines[view].len())
        }

        fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
            assert!(frame < self.frames(view), "asked for before it was there");
            Ok(self.lines[view][frame])
        }

        fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
            let lines = self.lines(view, frame)?;
            Ok(Frame { width: 1, lines, pixels: vec![1 + (10 * view + frame) as u8; lines] })
        }
    }

    /// First line, lines and pixels of every view, stretch by stretch.
    fn cuts(source: &Arriving, range: std::ops::Range<usize>) -> Vec<(usize, usize, Vec<Vec<u8>>)> {
        let mut reader = StretchReader::new(source, 1, 10, range, None).unwrap();
        let mut cuts = Vec::new();
        while let Some(stretch) = reader.next_stretch().unwrap() {
            let pixels = stretch.images.iter().map(|image| image.pixels().to_vec()).collect();
            cuts.push((stretch.first_line, stretch.lines, pixels));
        }
        cuts
    }

    #[test]
    fn the_cuts_are_the_same_whether_frames_are_there_or_still_arrive() {
        for rest in 0..12 {
            // Views of different lengths, cut into frames differently.
            let lines = [vec![7, 7, 7, 3, rest + 1], vec![20, 5], vec![4; 6]];
            for range in [0..usize::MAX, 5..24, 12..usize::MAX, 90..100] {
                let there = cuts(&Arriving::new(&lines, usize::MAX), range.clone());
                for known in 0..3 {
                    assert_eq!(cuts(&Arriving::new(&lines, known), range.clone()), there, "rest {rest}, {range:?}");
                }
                let covered: usize = there.iter().map(|(_, lines, _)| lines).sum();
                let end = range.end.min(lines[0].iter().sum::<usize>().max(25));
                assert_eq!(covered, end.saturating_sub(range.start), "every line is read once");
            }
        }
    }

    #[test]
    fn a_stretch_is_read_when_half_of_the_next_one_is_there_and_not_later() {
        let source = Arriving::new(&[vec![5; 20]], 0);
        let mut reader = StretchReader::new(&source, 1, 10, 0..usize::MAX, None).unwrap();
        assert!(!reader.is_there(), "nobody has looked for frames yet");
        let first = reader.next_stretch().unwrap().unwrap();
        assert_eq!((first.lines, source.frames(0)), (10, 3));
        assert!(!reader.is_there(), "the next one must be awaited");
        let whole = Arriving::new(&[vec![5; 20]], usize::MAX);
        assert!(StretchReader::new(&whole, 1, 10, 0..usize::MAX, None).unwrap().is_there());
    }
}
