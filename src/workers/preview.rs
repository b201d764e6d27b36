//! The job that looks at previews: aligns them as they arrive, then learns how the rope looks on the previews themselves and sees
//! where it looks otherwise. It has no result; it says in which order the frames are wanted.

use super::engine::Engine;
use super::watch::Watch;
use crate::pipeline::preview::{self, REDUCTION, line_of};
use crate::pipeline::results::{LayLengthRow, LineScoreFormat};
use crate::pipeline::{
    Acquisition, Found, FrameSource, InspectOptions, PipelineError, Progress, ProgressReport, TrainOptions,
    TrainingRange,
};
use crate::store::previewed::Suspicion;
use crate::store::previews::Preview;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Rope from which the look is learnt, in m: damage is a small part of so much, and more costs time.
const LEARNT_M: f64 = 20.0;
/// A strand lay that differs by more from the usual one is worth a look, as a share of it: ropes in service stay within 3 %
/// [Wacker13, sec. 4.3].
const STRAND_LAY_JUMP: f64 = 0.03;
/// The same for wire lays, which differ more from strand to strand.
const WIRE_LAY_JUMP: f64 = 0.10;
/// Share of the frames that are wanted sooner because of how they look: if everything is suspicious, nothing is.
const SUSPICIOUS_SHARE: f64 = 0.25;
/// Why wire lays of a single view are not told.
const WIRES_UNSURE: &str =
    "a single view of previews may count one wire too many or too few a turn: wire lays follow with the frames";
/// Suspicion of metres that could not be aligned; 1 is a score at the threshold, or a lay length at its limit.
const NOT_ALIGNED: f64 = 2.0;

/// A look at the previews of an acquisition.
pub(super) struct Run<'a> {
    pub engine: &'a dyn Engine,
    /// As its frames are.
    pub acquisition: &'a Acquisition,
    /// The previews.
    pub frames: &'a dyn FrameSource,
    pub work: &'a Path,
    pub watch: &'a Watch,
}

/// What was seen, in lines of previews.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// Estimates of all views together, stretch by stretch.
    rows: Vec<LayLengthRow>,
    /// Highest score of each line in any view, as a share of the threshold; empty if nothing could be learnt.
    scores: Vec<f32>,
}

/// Lines of previews that are suspicious.
struct Place {
    from: usize,
    to: usize,
    value: f64,
    reason: String,
}

impl Run<'_> {
    /// Waits for all previews and looks at them.
    pub fn look(&self) -> Result<Seen, PipelineError> {
        let acquisition = preview::reduced(self.acquisition);
        let single_view = self.frames.views() == 1;
        let alignment = Alignment { watch: self.watch, single_view, rows: Mutex::default() };
        let results = self.work.join("alignment");
        self.engine.inspect(&acquisition, self.frames, &InspectOptions::default(), &results, &alignment)?;
        let rows = alignment.rows.into_inner().unwrap_or_else(PoisonError::into_inner);
        let scores = match self.scores(&acquisition) {
            Ok(scores) => scores,
            Err(error @ (PipelineError::Cancelled | PipelineError::Source(_))) => return Err(error),
            Err(error) => {
                tracing::info!(%error, "the look of the rope could not be learnt from previews");
                Vec::new()
            }
        };
        Ok(Seen { rows, scores })
    }

    fn scores(&self, acquisition: &Acquisition) -> Result<Vec<f32>, PipelineError> {
        let (model_path, results) = (self.work.join("model"), self.work.join("appearance"));
        let unheard = Unheard(self.watch);
        let to_m = Some(acquisition.start_m + LEARNT_M);
        let range = TrainingRange { name: "the previews", acquisition, source: self.frames, from_m: None, to_m };
        let learnt = self.engine.train(&[range], TrainOptions::default(), &model_path, &unheard)?;
        let options = InspectOptions {
            model_path: Some(model_path),
            line_scores: LineScoreFormat::Binary,
            ..InspectOptions::default()
        };
        self.engine.inspect(acquisition, self.frames, &options, &results, &unheard)?;
        let mut shares: Vec<f32> = Vec::new();
        for view in 0..self.frames.views() {
            let path = results.join(format!("line_scores_view{view}.f32"));
            let bytes = std::fs::read(&path).map_err(|source| PipelineError::Write { path, source })?;
            shares.resize(shares.len().max(bytes.len() / 4), 0.0);
            for (share, score) in shares.iter_mut().zip(bytes.chunks_exact(4)) {
                let score = f32::from_le_bytes([score[0], score[1], score[2], score[3]]);
                *share = share.max(score / learnt.threshold as f32); // NaN: not seen, which alignment says
            }
        }
        Ok(shares)
    }
}

impl Seen {
    /// Which frames are wanted before the others.
    pub fn suspicions(&self, previews: &[Preview]) -> Vec<Suspicion> {
        let places = self.suspicious_places();
        let peaks: Vec<f32> = previews.iter().map(|p| self.peak(&lines(p))).collect();
        let mut sorted = peaks.clone();
        sorted.sort_by(|a, b| b.total_cmp(a));
        let sooner = (sorted.len() as f64 * SUSPICIOUS_SHARE).ceil() as usize;
        let least = sorted.get(sooner.saturating_sub(1)).copied().unwrap_or(f32::INFINITY);
        let suspicion = |(p, &peak): (&Preview, &f32)| {
            let lines = lines(p);
            let by_look =
                (peak > 0.0 && peak >= least).then(|| (f64::from(peak), "it looks unlike the rest".to_owned()));
            let here = places.iter().filter(|place| place.from < lines.end && lines.start < place.to);
            let by_lay = here.map(|place| (place.value, place.reason.clone()));
            let (value, reason) = by_look.into_iter().chain(by_lay).max_by(|a, b| a.0.total_cmp(&b.0))?;
            Some(Suspicion { view: p.view, frame: p.frame, value, reason })
        };
        previews.iter().zip(&peaks).filter_map(suspicion).collect()
    }

    fn peak(&self, lines: &std::ops::Range<usize>) -> f32 {
        let lines = lines.start..lines.end.min(self.scores.len());
        self.scores.get(lines).unwrap_or_default().iter().copied().fold(0.0, f32::max)
    }

    /// Stretches that were not aligned, or whose lay lengths are unusual.
    fn suspicious_places(&self) -> Vec<Place> {
        let usual_mm = median(self.rows.iter().filter_map(|row| row.strand_lay_mm));
        let usual_wire_mm = median(self.rows.iter().flat_map(|row| &row.wires).filter_map(|wire| wire.lay_mm));
        let mut places = Vec::new();
        for row in &self.rows {
            let (from, to) = (row.first_line, row.last_line + 1);
            let Some(lay_mm) = row.strand_lay_mm else {
                let reason = row.reason.as_deref().unwrap_or("no reason is known");
                let reason = format!("it could not be aligned: {reason}");
                places.push(Place { from, to, value: NOT_ALIGNED, reason });
                continue;
            };
            let wires = row.wires.iter().filter_map(|w| w.lay_mm).map(|mm| ("wire", mm, usual_wire_mm, WIRE_LAY_JUMP));
            for (what, mm, usual_mm, limit) in
                std::iter::once(("strand", lay_mm, usual_mm, STRAND_LAY_JUMP)).chain(wires)
            {
                let jump = ((mm - usual_mm) / usual_mm).abs() / limit;
                if jump > 1.0 {
                    let reason = format!("the {what} lay is {mm:.1} mm here, but {usual_mm:.1} mm elsewhere");
                    places.push(Place { from, to, value: jump.min(NOT_ALIGNED), reason });
                }
            }
        }
        places
    }
}

/// Lines of a preview among those of its view.
fn lines(preview: &Preview) -> std::ops::Range<usize> {
    let first = line_of(preview.first_line.unsigned_abs()) as usize;
    first..first + preview.lines as usize
}

/// NaN without values.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Passes on what alignment finds, in camera lines, and keeps the estimates of all views together.
struct Alignment<'a> {
    watch: &'a Watch,
    /// Nobody else saw the part of every turn that the view does not see.
    single_view: bool,
    rows: Mutex<Vec<LayLengthRow>>,
}

impl Progress for Alignment<'_> {
    fn report(&self, report: ProgressReport) {
        self.watch.report(report);
    }

    fn found(&self, mut found: Found) {
        let fused = found.lay_lengths.iter().filter(|row| row.view.is_none()).cloned();
        self.rows.lock().unwrap_or_else(PoisonError::into_inner).extend(fused);
        for row in &mut found.lay_lengths {
            row.first_line *= REDUCTION as usize;
            row.last_line = (row.last_line + 1) * REDUCTION as usize - 1;
            if self.single_view {
                leave_out_wires(row);
            }
        }
        self.watch.found(found);
    }

    fn cancelled(&self) -> bool {
        self.watch.cancelled()
    }
}

/// A jump of the wire lay is seen all the same, but how long it is would be a guess.
fn leave_out_wires(row: &mut LayLengthRow) {
    for wire in &mut row.wires {
        (wire.lay_mm, wire.lay_sd_mm) = (None, None);
    }
    row.reason.get_or_insert_with(|| WIRES_UNSURE.to_owned());
}

/// Says how far it is, but not what it finds: another pass over the same rope finds nothing that may be told.
struct Unheard<'a>(&'a Watch);

impl Progress for Unheard<'_> {
    fn report(&self, report: ProgressReport) {
        self.0.report(report);
    }

    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::results::WireEstimate;
    use crate::store::Id;
    use uuid::Uuid;

    /// Eight frames of 400 camera lines in one view.
    fn previews() -> Vec<Preview> {
        let preview = |frame: u32| Preview {
            acquisition_id: Id(Uuid::nil()),
            view: 0,
            frame,
            sha256: String::new(),
            bytes: 1,
            first_line: i64::from(frame) * 400,
            lines: 100,
            suspicion: None,
            reason: None,
            received_at_ms: 0,
        };
        (0..8).map(preview).collect()
    }

    fn row(n: usize, strand_lay_mm: Option<f64>) -> LayLengthRow {
        LayLengthRow {
            first_line: n * 50,
            last_line: n * 50 + 49,
            strand_lay_mm,
            reason: Some("too dark".into()),
            ..LayLengthRow::default()
        }
    }

    fn wanted(seen: &Seen) -> Vec<u32> {
        let mut suspicions = seen.suspicions(&previews());
        suspicions.sort_by(|a, b| b.value.total_cmp(&a.value));
        suspicions.iter().map(|s| s.frame).collect()
    }

    #[test]
    fn metres_that_were_not_aligned_come_first_then_lay_lengths_that_jump_then_looks() {
        let mut rows: Vec<_> = (0..16).map(|n| row(n, Some(220.0 + (n % 3) as f64))).collect();
        rows[9] = row(9, None); // frame 4
        rows[4].strand_lay_mm = Some(230.0); // frame 2
        let mut scores = vec![0.1; 800];
        scores[120] = 0.9; // frame 1
        scores[799] = 0.8; // frame 7
        scores[600] = 0.7; // frame 6: more than a quarter
        let seen = Seen { rows, scores };
        assert_eq!(wanted(&seen), [4, 2, 1, 7]);
        let reasons: Vec<_> = seen.suspicions(&previews()).into_iter().map(|s| s.reason).collect();
        assert!(reasons.iter().any(|r| r.contains("could not be aligned: too dark")), "{reasons:?}");
        assert!(reasons.iter().any(|r| r.contains("230.0 mm here, but 221.0 mm")), "{reasons:?}");
    }

    #[test]
    fn a_single_view_keeps_its_strand_lay_and_says_why_it_has_no_wire_lays() {
        let wire =
            WireEstimate { lay_mm: Some(95.0), lay_sd_mm: Some(0.1), score: Some(0.9), ..WireEstimate::default() };
        let mut seen = LayLengthRow { wires: vec![wire; 6], reason: None, ..row(0, Some(220.0)) };
        leave_out_wires(&mut seen);
        assert!(seen.wires.iter().all(|w| w.lay_mm.is_none() && w.lay_sd_mm.is_none()), "{seen:?}");
        assert_eq!((seen.strand_lay_mm, seen.reason.as_deref()), (Some(220.0), Some(WIRES_UNSURE)));
        let mut dark = row(1, None);
        leave_out_wires(&mut dark);
        assert_eq!(dark.reason.as_deref(), Some("too dark"), "the reason for the strands is the stronger one");
    }

    #[test]
    fn nothing_is_suspicious_where_nothing_was_learnt_and_nothing_jumps() {
        let rows = (0..16).map(|n| row(n, Some(220.0))).collect();
        assert_eq!(wanted(&Seen { rows, scores: Vec::new() }), [0; 0]);
    }
}
