//! Scores aligned stretches with a model, and gathers alarms, line scores and likelihood maps.

use super::fit::{IntactRope, ModelFit};
use super::found::{DefectsSoFar, FoundDefects};
use super::likelihood_map::LikelihoodMap;
use super::model_file::Model;
use super::results::{AlarmRow, DefectRow, Level, Suggestion, Threshold};
use super::signs::Looker;
use super::tables::LineValues;
use super::{Acquisition, PipelineError};
use crate::vision::aligner::AlignedStretch;
use crate::vision::camera::Camera;
use crate::vision::defects::{Alarm, AlarmBuilder, Defect};
use crate::vision::evidence::block_lines;
use crate::vision::inspection_model::{AlignedView, Seen, ViewAppearance};
use crate::vision::judging::Judging;
use crate::vision::margins::{MARGIN_BLOCKS, fill_between};
use crate::vision::merging::{OneCause, merge};
use crate::vision::stretch_scores::StretchScores;
use crate::vision::surface_map::PLACES_PER_WIRE;
use rayon::prelude::*;
use std::sync::Arc;

/// Gathers what a model finds, stretch after stretch.
pub(super) struct Detection<'a> {
    acquisition: &'a Acquisition,
    model: &'a Model,
    judging: Judging,
    threshold: f64,
    builders: Vec<AlarmBuilder>,
    /// The same over the second level, and that level; none if there is no such level.
    again: Option<(f64, Vec<AlarmBuilder>)>,
    so_far: DefectsSoFar,
    line_scores: LineValues,
    intact: IntactRope,
    waiting: Option<Waiting>,
}

/// A stretch that was seen, and is not judged before the end of the next one is seen, too.
struct Waiting {
    /// The one before it, if there is no gap between them.
    before: Option<Aligned>,
    aligned: Aligned,
    /// `[view]`.
    seen: Vec<Option<Seen>>,
}

/// A stretch with the cameras that saw it.
#[derive(Clone)]
struct Aligned {
    stretch: Arc<AlignedStretch>,
    cameras: Vec<Camera>,
}

impl Aligned {
    fn end_line(&self) -> usize {
        self.stretch.first_line + self.stretch.lines
    }

    /// View `v` of it; `None` where it cannot be judged.
    fn view<'a>(&'a self, acquisition: &'a Acquisition, v: usize) -> Option<AlignedView<'a>> {
        AlignedView::of(&acquisition.rope, &self.stretch, &self.cameras, v, acquisition.line_pitch_mm)
    }
}

/// What was told of a stretch.
pub(super) struct Judged {
    /// The line after its last.
    pub end_line: usize,
    /// Its likelihood maps, one a view; empty if they are not wanted.
    pub maps: Vec<LikelihoodMap>,
}

/// What a model found on the whole rope.
pub(super) struct Findings {
    /// The defects, along the rope.
    pub defects: Vec<DefectRow>,
    /// Places to look at again, along the rope; `None` without a second level.
    pub look_again: Option<Vec<DefectRow>>,
    /// Whether the model fits the rope; `None` if it does not know how intact rope scores.
    pub fit: Option<ModelFit>,
}

impl<'a> Detection<'a> {
    /// Nothing found yet.
    pub fn new(
        acquisition: &'a Acquisition,
        (model, judging): (&'a Model, Judging),
        threshold: &Threshold,
        line_scores: LineValues,
    ) -> Self {
        let builders = |level: f64| -> Vec<AlarmBuilder> {
            (0..model.views.len()).map(|v| AlarmBuilder::new(v, level, acquisition.line_pitch_mm)).collect()
        };
        Self {
            acquisition,
            model,
            judging,
            threshold: threshold.line_score,
            builders: builders(threshold.line_score),
            again: threshold.look_again_line_score.map(|level| (level, builders(level))),
            so_far: DefectsSoFar::default(),
            line_scores,
            intact: IntactRope::default(),
            waiting: None,
        }
    }

    /// Looks at a stretch, and judges the one before it. Likelihood maps are drawn if they are wanted.
    pub fn take(
        &mut self,
        stretch: Arc<AlignedStretch>,
        cameras: &[Camera],
        maps: bool,
    ) -> Result<Option<Judged>, PipelineError> {
        let aligned = Aligned { stretch, cameras: cameras.to_vec() };
        let view = |(v, model)| Some(aligned.view(self.acquisition, v)?.seen_by(model, MARGIN_BLOCKS));
        let mut seen: Vec<Option<Seen>> = self.model.views.par_iter().enumerate().map(view).collect();
        let Some(mut last) = self.waiting.take() else {
            self.waiting = Some(Waiting { before: None, aligned, seen });
            return Ok(None);
        };
        let goes_on = last.aligned.end_line() == aligned.stretch.first_line;
        if goes_on {
            fill_between(&mut last.seen, &mut seen);
        }
        let judged = self.judge(&last, goes_on.then_some(&aligned), maps)?;
        self.waiting = Some(Waiting { before: goes_on.then_some(last.aligned), aligned, seen });
        Ok(Some(judged))
    }

    /// Judges the last stretch, which nothing follows.
    pub fn take_last(&mut self, maps: bool) -> Result<Option<Judged>, PipelineError> {
        self.waiting.take().map(|last| self.judge(&last, None, maps)).transpose()
    }

    fn judge(
        &mut self,
        Waiting { before, aligned, seen }: &Waiting,
        after: Option<&Aligned>,
        maps: bool,
    ) -> Result<Judged, PipelineError> {
        let (acquisition, stretch) = (self.acquisition, &aligned.stretch);
        let strands = acquisition.rope.strands();
        let pitch_mm = acquisition.line_pitch_mm;
        let (model, threshold) = (self.model, self.threshold);
        let beside = [before.as_ref(), Some(aligned), after];
        let score = |(v, (seen, view)): (usize, (&Option<Seen>, &ViewAppearance))| {
            let image = beside.map(|aligned| aligned?.view(acquisition, v));
            Some(self.judging.score(view, (seen.as_ref()?, image), strands, pitch_mm))
        };
        let mut scored: Vec<Option<StretchScores>> = seen.par_iter().zip(&model.views).enumerate().map(score).collect();
        self.judging.join(&mut scored, strands);
        let block_mm = block_lines(pitch_mm) as f64 * pitch_mm;
        scored.par_iter_mut().flatten().for_each(|scores| {
            model.lasting.raise(scores, block_mm);
            scores.add_closer_look();
            scores.cut_margins(MARGIN_BLOCKS);
        });
        self.intact.add(&scored, model.report.threshold, block_mm);
        let sensor_px = self.acquisition.sensor_px as usize;
        let again: Vec<Option<(f64, &mut AlarmBuilder)>> = match &mut self.again {
            Some((level, builders)) => builders.iter_mut().map(|builder| Some((*level, builder))).collect(),
            None => scored.iter().map(|_| None).collect(),
        };
        let drawn: Vec<LikelihoodMap> = self
            .builders
            .par_iter_mut()
            .zip(again)
            .enumerate()
            .map(|(v, (builder, again))| {
                let (Some(seen), Some(scores)) = (aligned.view(acquisition, v), &scored[v]) else {
                    let nothing = || LikelihoodMap::not_judged(sensor_px, stretch.lines);
                    return if maps { nothing() } else { LikelihoodMap::default() };
                };
                let mut looker = Looker::new(seen, scores, &model.views[v].gray);
                for (level, builder) in [(threshold, builder)].into_iter().chain(again) {
                    builder.add(
                        stretch.first_line,
                        stretch.lines,
                        scores,
                        1.0 / PLACES_PER_WIRE as f64,
                        |block, peak| looker.look(block, peak, level),
                    );
                }
                if maps { LikelihoodMap::of(&seen, scores, model.report.threshold) } else { LikelihoodMap::default() }
            })
            .collect();
        let mut images = Vec::new();
        for (v, (scores, map)) in scored.into_iter().zip(drawn).enumerate() {
            let of_line = |k: usize| scores.as_ref().map_or(f32::NAN, |s| s.blocks[k / s.block_lines]);
            self.line_scores.append(v, (0..stretch.lines).map(of_line))?;
            images.push(map);
        }
        Ok(Judged { end_line: stretch.first_line + stretch.lines, maps: images })
    }

    /// What is new among the defects when everything before `next_line` was taken.
    pub fn so_far(&mut self, next_line: usize) -> FoundDefects {
        self.so_far.look(self.acquisition, &self.builders, next_line)
    }

    /// What was found on the whole rope, and the scores of its lines.
    pub fn finish(self) -> (Findings, LineValues) {
        let ranked = |mut rows: Vec<DefectRow>| {
            let mut order: Vec<usize> = (0..rows.len()).collect();
            order.sort_by(|&a, &b| rows[b].peak_score.total_cmp(&rows[a].peak_score).then(a.cmp(&b)));
            order.into_iter().enumerate().for_each(|(place, row)| rows[row].rank = Some(place + 1));
            rows
        };
        let one_cause = OneCause::on(&self.acquisition.rope, self.acquisition.line_pitch_mm);
        let merged = |builders: Vec<AlarmBuilder>| {
            merge(builders.into_iter().flat_map(AlarmBuilder::finish).collect(), &one_cause)
        };
        let defects = merged(self.builders);
        let again = self.again.map(|(_, builders)| beside(merged(builders), &defects));
        let row = |(id, defect): (usize, &Defect)| defect_row(self.acquisition, id, defect);
        let again = again.map(|again| {
            let places = again.iter().enumerate().map(|(n, place)| row((defects.len() + n, place)));
            ranked(places.map(|place| DefectRow { level: Level::LookAgain, ..place }).collect())
        });
        let report = &self.model.report;
        let findings = Findings {
            defects: ranked(defects.iter().enumerate().map(row).collect()),
            look_again: again,
            fit: report.budget.as_ref().map(|budget| self.intact.fit(budget, &report.intact)),
        };
        (findings, self.line_scores)
    }
}

/// Those places that no view shows in the lines of a defect on its strand: the others are the defects themselves, a little longer. What
/// another view or another strand shows is a place of its own.
fn beside(places: Vec<Defect>, defects: &[Defect]) -> Vec<Defect> {
    let meet = |a: &Alarm, b: &Alarm| {
        (a.view, a.strand) == (b.view, b.strand) && a.first_line <= b.last_line && b.first_line <= a.last_line
    };
    let touches = |place: &Defect, defect: &Defect| {
        place.alarms.iter().any(|alarm| defect.alarms.iter().any(|other| meet(alarm, other)))
    };
    places.into_iter().filter(|place| !defects.iter().any(|defect| touches(place, defect))).collect()
}

/// A defect as the tables show it.
pub(super) fn defect_row(acquisition: &Acquisition, id: usize, defect: &Defect) -> DefectRow {
    let peak = defect.peak();
    let figures = defect.figures();
    DefectRow {
        id,
        level: Level::Alarm,
        from_m: acquisition.position_m(defect.first_line()),
        to_m: acquisition.position_m(defect.last_line() + 1),
        strand: peak.map(|p| p.strand),
        wire: peak.map(|p| p.wire),
        angle_deg: figures.map(|f| f.angle_rad.to_degrees().rem_euclid(360.0)),
        peak_score: peak.map_or(0.0, |p| p.peak_score),
        rank: None,
        suggestion: figures.map(Suggestion::from),
        alarms: defect
            .alarms
            .iter()
            .map(|a| AlarmRow {
                view: a.view,
                strand: Some(a.strand),
                first_line: a.first_line,
                last_line: a.last_line,
                first_column: a.first_column,
                last_column: a.last_column,
                peak_score: a.peak_score,
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::kind::Signs;

    #[test]
    fn a_place_that_another_view_or_strand_shows_is_no_part_of_a_defect_at_the_same_metre() {
        let alarm = |view, first_line, last_line, strand| Alarm {
            view,
            first_line,
            last_line,
            first_column: 0,
            last_column: 9,
            peak_score: 12.0,
            strand,
            wire: 0,
            signs: Signs::default(),
            ends: [(0.0, 0.0); 2],
        };
        let missing_wire = Defect { alarms: vec![alarm(0, 1000, 2500, 1), alarm(1, 1100, 2400, 1)] };
        let wider = Defect { alarms: vec![alarm(0, 950, 2600, 1), alarm(1, 1050, 2500, 1), alarm(2, 990, 1010, 1)] };
        let round_the_rope = Defect { alarms: vec![alarm(2, 1500, 1520, 4)] };
        let on_another_strand = Defect { alarms: vec![alarm(1, 1600, 1620, 3)] };
        let own = [round_the_rope, on_another_strand];
        assert_eq!(beside([vec![wider], own.to_vec()].concat(), &[missing_wire]), own);
    }
}
