//! An acquisition folder that a command works on: checked, and its length known before the work begins.

use ropescope::pipeline::acquisition::open_folder;
use ropescope::pipeline::{Acquisition, FrameFiles, FrameSource};
use std::path::Path;

/// A checked acquisition folder.
pub(crate) struct Recording {
    /// What `rope.json` says.
    pub acquisition: Acquisition,
    /// Its frames.
    pub frames: FrameFiles,
    /// Lines of each view.
    pub lines: Vec<usize>,
}

impl Recording {
    /// Reads `rope.json` and the header of every frame. Errors: what is wrong with either, before any pixel is decoded.
    pub(crate) fn open(folder: &Path) -> anyhow::Result<Self> {
        let (acquisition, frames) = open_folder(folder)?;
        let lines = (0..frames.views())
            .map(|view| (0..frames.frames(view)).map(|frame| frames.lines(view, frame)).sum())
            .collect::<Result<Vec<usize>, _>>()?;
        Ok(Self { acquisition, frames, lines })
    }

    /// Rope metre of the end of the longest view.
    pub(crate) fn end_m(&self) -> f64 {
        self.acquisition.position_m(self.lines.iter().copied().max().unwrap_or(0))
    }

    /// One line about it.
    pub(crate) fn describe(&self) -> String {
        let (from_m, to_m) = (self.acquisition.start_m, self.end_m());
        format!(
            "{}, {:.2} m of rope from metre {from_m:.2} to {to_m:.2}",
            self.acquisition.construction(),
            to_m - from_m
        )
    }
}
