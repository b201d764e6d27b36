//! Passes over the ranges that a training reads: one range after the other, each aligned by itself, all counted as one rope.

use super::drive::Drive;
use super::progress::Quiet;
use super::stretches::STRETCH_LINES;
use super::training_range::{LearntFrom, TrainingRange};
use super::{PipelineError, Progress, ProgressReport};
use crate::vision::inspection_model::AlignedView;
use rayon::prelude::*;
use std::ops::Range;

/// A range, and the lines of it that are there.
pub(super) struct Used<'a> {
    pub range: &'a TrainingRange<'a>,
    pub lines: Range<usize>,
}

impl<'a> Used<'a> {
    /// Errors: there are none.
    pub fn of(range: &'a TrainingRange<'a>) -> Result<Self, PipelineError> {
        let used = Self { range, lines: range.lines() };
        let drive = used.drive("look", &Quiet);
        let reader = drive.reader()?;
        let (lines, all) = (reader.range(), reader.lines());
        if lines.is_empty() {
            return Err(PipelineError::NothingInRange {
                acquisition: range.name.to_owned(),
                start_m: range.acquisition.start_m,
                end_m: range.acquisition.position_m(all),
            });
        }
        Ok(Self { range, lines })
    }

    fn drive<'b>(&'b self, stage: &'static str, progress: &'b dyn Progress) -> Drive<'b> {
        let TrainingRange { acquisition, source, .. } = *self.range;
        Drive { acquisition, source, range: self.lines.clone(), given_contours: None, stage, progress }
    }

    /// Lines of its stretches.
    pub fn stretch_lines(&self) -> usize {
        self.range.acquisition.aligner_spec().stretch_lines(STRETCH_LINES)
    }

    /// Rope metres of its first line and of its end.
    pub fn range_m(&self) -> (f64, f64) {
        let acquisition = self.range.acquisition;
        (acquisition.position_m(self.lines.start), acquisition.position_m(self.lines.end))
    }

    fn metres(&self) -> f64 {
        self.lines.len() as f64 * self.range.acquisition.line_pitch_mm / 1000.0
    }

    /// What it gave, if so many metres were learnt from.
    pub fn gave(&self, learnt_view_m: f64) -> LearntFrom {
        let (from_m, to_m) = self.range_m();
        LearntFrom { acquisition: self.range.name.to_owned(), from_m, to_m, learnt_view_m }
    }
}

/// A pass over all ranges, one after the other: stretches are numbered on (one number is left out between two
/// ranges), and progress goes on, as if they were one.
pub(super) struct Pass<'a> {
    pub used: &'a [Used<'a>],
    pub stage: &'static str,
    pub progress: &'a dyn Progress,
}

impl Pass<'_> {
    /// Aligns every range by itself and hands every usable view of the stretches that are `wanted` (by number) to `take`, with its
    /// number and what that view gathers; all views at once. Returns the metres that every range gave, summed over the views.
    pub fn each_view<T: Send>(
        &self,
        gathered: &mut [T],
        wanted: impl Fn(usize) -> bool + Sync,
        take: impl Fn(usize, AlignedView<'_>, &mut T) + Sync,
    ) -> Result<Vec<f64>, PipelineError> {
        let total_m = self.used.iter().map(Used::metres).sum();
        let (mut number, mut before_m) = (0, 0.0);
        let mut given_view_m = vec![0.0; self.used.len()];
        for (used, given_view_m) in self.used.iter().zip(&mut given_view_m) {
            let rope = &used.range.acquisition.rope;
            let pitch_mm = used.range.acquisition.line_pitch_mm;
            let progress = PartOf { whole: self.progress, before_m, total_m };
            let drive = used.drive(self.stage, &progress);
            drive.run(&mut drive.reader()?, |stretch, cameras| {
                let this = number;
                number += 1;
                if wanted(this) && stretch.estimates.is_ok() {
                    gathered.par_iter_mut().enumerate().for_each(|(v, gathered)| {
                        if let Some(view) = AlignedView::of(rope, &stretch, cameras, v, pitch_mm) {
                            take(this, view, gathered);
                        }
                    });
                    let lines: usize = stretch.views.iter().filter(|v| v.usable()).map(|v| v.lines_seen()).sum();
                    *given_view_m += lines as f64 * pitch_mm / 1000.0;
                }
                Ok(())
            })?;
            before_m += used.metres();
            number += 1; // the next range does not go on where this one ends
        }
        Ok(given_view_m)
    }
}

/// Progress of one range as that of all.
struct PartOf<'a> {
    whole: &'a dyn Progress,
    before_m: f64,
    total_m: f64,
}

impl Progress for PartOf<'_> {
    fn report(&self, report: ProgressReport) {
        self.whole.report(ProgressReport { done_m: self.before_m + report.done_m, total_m: self.total_m, ..report });
    }

    fn cancelled(&self) -> bool {
        self.whole.cancelled()
    }
}
