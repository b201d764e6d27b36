//! Runs the aligner over a range of an acquisition and hands out aligned stretches, in order.

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
    /// While a stretch is aligned, those before it are taken and the next one is decoded: none of the three keeps all processors
    /// busy by itself.
    pub fn run_telling(
        &self,
        reader: &mut StretchReader<'_>,
        mut tell: impl FnMut(&[AlignedStretch]) -> Result<(), PipelineError>,
        mut take: impl FnMut(AlignedStretch, &[Camera]) -> Result<(), PipelineError> + Send,
    ) -> Result<(), PipelineError> {
        let first_line = reader.range().start;
        let pitch_m = self.acquisition.line_pitch_mm / 1000.0;
        let mut take_all = |settled: Settled| -> Result<(), PipelineError> {
            for stretch in settled.stretches {
                let done_m = (stretch.first_line + stretch.lines - first_line) as f64 * pitch_m;
                take(stretch, &settled.cameras)?;
                self.progress.report(ProgressReport { stage: self.stage, done_m, total_m: settled.total_m });
            }
            Ok(())
        };
        let mut aligner = Aligner::new(self.acquisition.aligner_spec());
        let (mut ahead, mut settled) = (None, Settled::default());
        loop {
            if self.progress.cancelled() {
                return Err(PipelineError::Cancelled);
            }
            let next = ahead.take().unwrap_or_else(|| reader.next_stretch())?;
            let last = next.is_none();
            let before = std::mem::take(&mut settled);
            // Nobody waits for a frame in here, where others' work waits, too.
            let (aligned, (read, taken)) = rayon::join(
                || match next {
                    Some(stretch) => aligner.push(stretch),
                    None => aligner.finish(),
                },
                || rayon::join(|| (!last && reader.is_there()).then(|| reader.next_stretch()), || take_all(before)),
            );
            taken?;
            ahead = read;
            if !aligned.is_empty() {
                tell(&aligned)?;
            }
            settled = Settled {
                stretches: aligned,
                cameras: aligner.cameras().unwrap_or_default(),
                total_m: (reader.range().end - first_line) as f64 * pitch_m,
            };
            // What is known does not wait for frames that are still to come.
            if ahead.is_none() {
                take_all(std::mem::take(&mut settled))?;
            }
            if last {
                return Ok(());
            }
        }
    }
}

/// Stretches that are aligned and not yet taken.
#[derive(Default)]
struct Settled {
    stretches: Vec<AlignedStretch>,
    cameras: Vec<Camera>,
    total_m: f64,
}
