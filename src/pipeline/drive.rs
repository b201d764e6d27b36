//! Runs the aligner over a range of an acquisition and hands out aligned stretches, in order.

use super::behind::Behind;
use super::stretches::{STRETCH_LINES, StretchReader};
use super::{Acquisition, FrameSource, PipelineError, Progress, ProgressReport};
use crate::vision::aligner::{AlignedStretch, Aligner};
use crate::vision::camera::Camera;

/// Which lines to align, and how the run reports.
pub(super) struct Drive<'a> {
    pub acquisition: &'a Acquisition,
    pub source: &'a dyn FrameSource,
    pub range: std::ops::Range<usize>,
    pub given_contours: Option<&'a [Vec<(f32, f32)>]>,
    pub stage: &'static str,
    pub progress: &'a dyn Progress,
}

impl Drive<'_> {
    /// The reader for the range.
    pub fn reader(&self) -> Result<StretchReader<'_>, PipelineError> {
        let spec = self.acquisition.aligner_spec();
        let lines = spec.stretch_lines(STRETCH_LINES / self.acquisition.reduction as usize);
        Ok(StretchReader::new(self.source, spec.width_px, lines, self.range.clone(), self.given_contours)?)
    }

    /// Aligns the range; `take` gets every stretch in order, with the cameras (empty while none is known).
    pub fn run(
        &self,
        reader: &mut StretchReader<'_>,
        take: impl FnMut(AlignedStretch, &[Camera]) -> Result<(), PipelineError> + Send,
    ) -> Result<(), PipelineError> {
        self.run_telling(reader, |_| Ok(()), take)
    }

    /// The same; `tell` sees stretches that were settled together before the first of them is taken.
    ///
    /// While a stretch is aligned, the next one is decoded and those before it are taken: none of the three keeps all processors busy
    /// by itself. Not to be called from a task of the pool in which all of them work.
    pub fn run_telling(
        &self,
        reader: &mut StretchReader<'_>,
        mut tell: impl FnMut(&[AlignedStretch]) -> Result<(), PipelineError>,
        mut take: impl FnMut(AlignedStretch, &[Camera]) -> Result<(), PipelineError> + Send,
    ) -> Result<(), PipelineError> {
        let first_line = reader.range().start;
        let pitch_m = self.acquisition.line_pitch_mm / 1000.0;
        let take_all = |settled: Settled| -> Result<(), PipelineError> {
            for stretch in settled.stretches {
                let done_m = (stretch.first_line + stretch.lines - first_line) as f64 * pitch_m;
                take(stretch, &settled.cameras)?;
                self.progress.report(ProgressReport { stage: self.stage, done_m, total_m: settled.total_m });
            }
            Ok(())
        };
        let mut aligner = Aligner::new(self.acquisition.aligner_spec());
        std::thread::scope(|scope| {
            let mut taker = Behind::start(scope, take_all);
            let mut ahead = None;
            loop {
                if self.progress.cancelled() {
                    return Err(PipelineError::Cancelled);
                }
                let next = ahead.take().unwrap_or_else(|| reader.next_stretch())?;
                let last = next.is_none();
                // Nobody waits for a frame in here, where others' work waits, too.
                let (stretches, read) = rayon::join(
                    || match next {
                        Some(stretch) => aligner.push(stretch),
                        None => aligner.finish(),
                    },
                    || (!last && reader.is_there()).then(|| reader.next_stretch()),
                );
                ahead = read;
                if !stretches.is_empty() {
                    tell(&stretches)?;
                    let cameras = aligner.cameras().unwrap_or_default();
                    let total_m = (reader.range().end - first_line) as f64 * pitch_m;
                    taker.give(Settled { stretches, cameras, total_m })?;
                }
                // What went wrong with what is known does not wait for frames that are still to come.
                if ahead.is_none() {
                    taker.catch_up()?;
                }
                if last {
                    return Ok(());
                }
            }
        })
    }
}

/// Stretches that are aligned and not yet taken.
struct Settled {
    stretches: Vec<AlignedStretch>,
    cameras: Vec<Camera>,
    total_m: f64,
}
