//! How much rope the experiment gets.

/// The amount of everything.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Every random choice follows from it.
    pub seed: u64,
    /// Metres of rope, the training part included.
    pub metres: f64,
    /// Metres at the beginning that are intact and trained on.
    pub train_m: f64,
    /// Defects planted behind them.
    pub defects: usize,
    /// Cameras, evenly round the rope.
    pub views: usize,
    /// Columns of a camera; the rope fills 380 of 480.
    pub sensor_px: u32,
    /// Whether simpler configurations judge the rope, too.
    pub ablation: bool,
}

impl Plan {
    /// The paper's experiment.
    pub fn full(seed: u64) -> Self {
        Self { seed, metres: 400.0, train_m: 5.0, defects: 37, views: 4, sensor_px: 480, ablation: true }
    }

    /// About a minute: as little rope as a model can be trained on and defects fit on, two views of half the columns.
    pub fn quick(seed: u64) -> Self {
        Self { seed, metres: 3.6, train_m: 2.0, defects: 8, views: 2, sensor_px: 240, ablation: true }
    }

    /// Lines that were trained on.
    pub(super) fn skip_lines(&self, line_pitch_mm: f64) -> usize {
        (self.train_m * 1000.0 / line_pitch_mm).round() as usize
    }
}
