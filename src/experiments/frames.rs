//! Simulated frames as a source: rendered when they are asked for, so that no length of rope needs a disk.

use crate::pipeline::source::Frame;
use crate::pipeline::{FrameSource, SourceError};
use crate::simulate::{Scene, render_view_frame};
use rayon::prelude::*;

/// The frames of a scene, rendered one by one.
pub(super) struct SceneFrames<'a>(pub &'a Scene);

fn check(source: &dyn FrameSource, view: usize, frame: usize) -> Result<(), SourceError> {
    let frames = if view < source.views() { source.frames(view) } else { 0 };
    if frame < frames { Ok(()) } else { Err(SourceError::NoSuchFrame { view, frame, frames }) }
}

impl FrameSource for SceneFrames<'_> {
    fn views(&self) -> usize {
        self.0.views()
    }

    fn frames(&self, _view: usize) -> usize {
        self.0.frames()
    }

    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
        check(self, view, frame)?;
        Ok(self.0.frame_height(frame))
    }

    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
        check(self, view, frame)?;
        let width = self.0.recipe().sensor_px as usize;
        let pixels = render_view_frame(self.0, view, frame);
        Ok(Frame { width, lines: self.0.frame_height(frame), pixels })
    }
}

/// Frames of one view held in memory: a short recording that is looked at many times.
pub(super) struct HeldFrames(Vec<Frame>);

impl HeldFrames {
    /// Renders view 0 of a scene.
    pub fn render(scene: &Scene) -> Result<Self, SourceError> {
        let source = SceneFrames(scene);
        (0..scene.frames()).into_par_iter().map(|frame| source.load(0, frame)).collect::<Result<_, _>>().map(Self)
    }

    /// The same with every line moved sideways by what `shift_px` says for it, towards larger columns.
    pub fn deformed(&self, shift_px: impl Fn(usize) -> f64 + Sync) -> Self {
        let mut first_line = 0;
        let starts: Vec<usize> = self
            .0
            .iter()
            .map(|frame| {
                first_line += frame.lines;
                first_line - frame.lines
            })
            .collect();
        let frames = self.0.par_iter().zip(starts).map(|(frame, start)| {
            let rows = frame.pixels.chunks_exact(frame.width).enumerate();
            let pixels = rows.flat_map(|(k, row)| moved(row, shift_px(start + k))).collect();
            Frame { pixels, ..*frame }
        });
        Self(frames.collect())
    }
}

/// A row of gray values moved by a part of a pixel: cubic between four neighbours, which keeps edges as sharp as they are.
fn moved(row: &[u8], shift_px: f64) -> Vec<u8> {
    let last = row.len() as i64 - 1;
    (0..row.len())
        .map(|column| {
            let from = column as f64 - shift_px;
            let (cell, t) = (from.floor(), from - from.floor());
            let gray = |k: i64| f64::from(row[(cell as i64 + k).clamp(0, last) as usize]);
            let (a, b, c, d) = (gray(-1), gray(0), gray(1), gray(2));
            let value = b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)));
            value.round().clamp(0.0, 255.0) as u8
        })
        .collect()
}

impl FrameSource for HeldFrames {
    fn views(&self) -> usize {
        1
    }

    fn frames(&self, _view: usize) -> usize {
        self.0.len()
    }

    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
        check(self, view, frame)?;
        Ok(self.0[frame].lines)
    }

    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
        check(self, view, frame)?;
        Ok(self.0[frame].clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moved_row_is_where_it_should_be_and_as_bright_as_before() {
        let row: Vec<u8> = (0..60).map(|c| (120.0 + 100.0 * (f64::from(c) * 0.3).sin()) as u8).collect();
        for shift_px in [0.0, 0.4, -2.7, 3.0] {
            let moved = moved(&row, shift_px);
            for (column, &gray) in moved.iter().enumerate().take(55).skip(5) {
                let expected = 120.0 + 100.0 * ((column as f64 - shift_px) * 0.3).sin();
                assert!((f64::from(gray) - expected).abs() < 2.5, "{shift_px} {column}: {gray} {expected}");
            }
        }
    }
}
