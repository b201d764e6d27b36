//! Simulated frames as a source: rendered when they are asked for, so that no length of rope needs a disk.

use crate::pipeline::source::Frame;
use crate::pipeline::{FrameSource, SourceError};
use crate::simulate::{Scene, render_view_frame};
use rayon::prelude::*;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

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

/// The frames of a scene, each of the first ones rendered once however often it is asked for, and the others some frames ahead: one view
/// after the other is read, so with more processors than views some would wait.
pub(super) struct KeptFrames<'a> {
    scene: SceneFrames<'a>,
    /// `[view][frame]`
    kept: Vec<Vec<OnceLock<Frame>>>,
    /// `[view]`: rendered ahead, in order.
    ahead: Vec<Mutex<Vec<(usize, Frame)>>>,
    /// Frames of a view that are rendered at once.
    at_once: usize,
}

impl<'a> KeptFrames<'a> {
    /// Keeps the frames of the first lines.
    pub fn new(scene: &'a Scene, kept_lines: usize) -> Self {
        let frames = (0..scene.frames()).take_while(|&frame| scene.first_line(frame) < kept_lines).count();
        Self {
            scene: SceneFrames(scene),
            kept: vec![vec![OnceLock::new(); frames]; scene.views()],
            ahead: (0..scene.views()).map(|_| Mutex::default()).collect(),
            at_once: rayon::current_num_threads().div_ceil(scene.views().max(1)),
        }
    }

    fn waiting(&self, view: usize) -> MutexGuard<'_, Vec<(usize, Frame)>> {
        self.ahead[view].lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl FrameSource for KeptFrames<'_> {
    fn views(&self) -> usize {
        self.scene.views()
    }

    fn frames(&self, view: usize) -> usize {
        self.scene.frames(view)
    }

    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
        self.scene.lines(view, frame)
    }

    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
        check(self, view, frame)?;
        if let Some(kept) = self.kept[view].get(frame) {
            return match kept.get() {
                Some(rendered) => Ok(rendered.clone()),
                None => self.scene.load(view, frame).map(|rendered| kept.get_or_init(|| rendered).clone()),
            };
        }
        let waiting = std::mem::take(&mut *self.waiting(view)).into_iter();
        let mut frames: Vec<(usize, Frame)> = waiting.skip_while(|(number, _)| *number != frame).collect();
        if frames.is_empty() {
            // Nobody holds a lock meanwhile: this thread may be lent to another view.
            let numbers = frame..(frame + self.at_once).min(self.frames(view));
            let rendered = numbers.into_par_iter().map(|number| Ok((number, self.scene.load(view, number)?)));
            frames = rendered.collect::<Result<_, SourceError>>()?;
        }
        let (_, first) = frames.remove(0);
        *self.waiting(view) = frames;
        Ok(first)
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
    use crate::simulate::Recipe;

    #[test]
    fn frames_that_are_kept_or_rendered_ahead_are_those_of_the_scene() {
        let recipe = Recipe {
            metres: 0.3,
            defects: 0,
            view_angles_deg: Recipe::evenly_spaced(2),
            sensor_px: 120,
            rope_width_px: 95.0,
            frame_lines: 500,
            ..Recipe::photographic()
        };
        let scene = Scene::new(&recipe, 3).unwrap();
        let plain = SceneFrames(&scene);
        let ahead = KeptFrames { at_once: 3, ..KeptFrames::new(&scene, 1001) };
        assert_eq!(ahead.kept[0].len(), 3);
        // In order, twice from the start, and not in order.
        for frame in [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 5, 4, 3] {
            for view in [0, 1] {
                let (kept, rendered) = (ahead.load(view, frame).unwrap(), plain.load(view, frame).unwrap());
                assert!(kept.pixels == rendered.pixels && kept.lines == rendered.lines, "{view} {frame}");
            }
        }
        assert!(ahead.load(0, 6).is_err());
    }

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
