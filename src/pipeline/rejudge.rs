//! What another threshold would decide: from stored line scores, without looking at the rope again.
//!
//! Stored scores do not tell strands apart, so alarms of two strands at one place count as one place here.

use super::reinspection::{context_lines, lines_to_look_at};
use crate::vision::defects::{AlarmBuilder, Look};
use crate::vision::merging::{OneCause, merge};
use crate::vision::stretch_scores::StretchScores;
use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::ops::Range;

/// Steps of a score that thresholds for a budget lie on; a choice, finer than the fourth digit of any threshold that is worth trying.
const STEPS_PER_SCORE: f64 = 4096.0;

/// The highest score of every line over all views, as runs of lines of one score.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoreCourse {
    /// Score, NaN where no view was inspected, and lines.
    runs: Vec<(f32, usize)>,
    pitch_mm: f64,
}

/// A place of the rope over a threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// First line.
    pub first_line: usize,
    /// Last line.
    pub last_line: usize,
    /// Highest score.
    pub peak_score: f64,
}

/// What a threshold decides on one inspection.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// Metres of rope that a person has to look at again: alarms of any view with their context.
    pub reinspect_m: f64,
    /// Alarms of one cause each, along the rope.
    pub places: Vec<Place>,
}

impl ScoreCourse {
    /// Reads one file of little-endian f32 a view, as inspections leave them.
    pub fn read(mut views: Vec<impl Read>, pitch_mm: f64) -> std::io::Result<Self> {
        let mut runs: Vec<(f32, usize)> = Vec::new();
        loop {
            let mut score = f32::NAN;
            let mut ended = 0;
            for view in &mut views {
                let mut bytes = [0; 4];
                match view.read_exact(&mut bytes) {
                    Ok(()) => score = score.max(f32::from_le_bytes(bytes)), // takes the number where the other is NaN
                    Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => ended += 1,
                    Err(e) => return Err(e),
                }
            }
            if ended == views.len() {
                return Ok(Self { runs, pitch_mm });
            }
            match runs.last_mut() {
                Some((last, lines)) if last.to_bits() == score.to_bits() => *lines += 1,
                _ => runs.push((score, 1)),
            }
        }
    }

    /// Metres of rope that any view inspected.
    pub fn inspected_m(&self) -> f64 {
        self.metres(self.runs.iter().filter(|(score, _)| score.is_finite()).map(|(_, lines)| lines).sum())
    }

    fn metres(&self, lines: usize) -> f64 {
        lines as f64 * self.pitch_mm / 1000.0
    }

    /// Decides by a threshold, as an inspection does.
    pub fn judge(&self, threshold: f64) -> Judgement {
        let mut builder = AlarmBuilder::new(0, threshold, self.pitch_mm);
        let mut first_line = 0;
        for &(score, lines) in &self.runs {
            if f64::from(score) > threshold {
                builder.add(first_line, lines, &one_block(score, first_line, lines), 1.0, |_, _| Look::default());
            }
            first_line += lines;
        }
        let alarms = builder.finish();
        let extents = alarms.iter().map(|a| (a.first_line, a.last_line));
        let reinspect_m = self.metres(lines_to_look_at(extents, self.pitch_mm, first_line));
        let places = merge(alarms, &OneCause::of_runs(self.pitch_mm))
            .iter()
            .map(|d| Place {
                first_line: d.first_line(),
                last_line: d.last_line(),
                peak_score: d.peak().map_or(threshold, |p| p.peak_score),
            })
            .collect();
        Judgement { reinspect_m, places }
    }

    /// The highest score within the context of every line, as runs of lines along the rope: thresholds under it have the line looked at.
    /// Lines without any score so near are left out.
    fn highest_around(&self, mut take: impl FnMut(f32, usize)) {
        let context = context_lines(self.pitch_mm);
        // Scores that may still be the highest, each lower than the one before it, and the line that its context ends before.
        let mut near: VecDeque<(f32, usize)> = VecDeque::new();
        let (mut told, mut first_line) = (0_usize, 0_usize);
        for &(score, lines) in &self.runs {
            let reaches_from = first_line.saturating_sub(context);
            first_line += lines;
            if score.is_finite() {
                tell_highest(&mut near, told..reaches_from, &mut take);
                told = reaches_from;
                while near.back().is_some_and(|&(other, _)| other <= score) {
                    near.pop_back();
                }
                near.push_back((score, first_line + context));
            }
        }
        tell_highest(&mut near, told..first_line, &mut take);
    }
}

/// Tells the first of the scores for the lines of the range, each as far as its context goes; those behind are forgotten.
fn tell_highest(near: &mut VecDeque<(f32, usize)>, mut lines: Range<usize>, take: &mut impl FnMut(f32, usize)) {
    while !lines.is_empty() {
        match near.front().copied() {
            Some((_, end)) if end <= lines.start => {
                near.pop_front();
            }
            Some((score, end)) => {
                let to = end.min(lines.end);
                take(score, to - lines.start);
                lines.start = to;
            }
            None => return,
        }
    }
}

/// Line scores know no wires: every run counts as one of its own, so that none are joined from pass to pass of a wire.
fn one_block(score: f32, first_line: usize, lines: usize) -> StretchScores {
    StretchScores {
        cells: Vec::new(),
        added: Vec::new(),
        looks: Vec::new(),
        visibility: Vec::new(),
        blocks: vec![score],
        peaks: vec![(0, first_line)],
        block_lines: lines,
        places: 1,
    }
}

/// Metres that every threshold would have people look at on several inspections: all that a budget of metres has to know of them. It takes
/// some megabytes, however much rope that is, because scores are rounded up to whole steps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MetresToLookAt {
    inspected_m: f64,
    lowest: Option<f64>,
    /// Metres by the highest score in their context, in steps.
    by_step: BTreeMap<i64, f64>,
}

impl MetresToLookAt {
    /// Adds an inspection.
    pub fn add(&mut self, course: &ScoreCourse) {
        self.inspected_m += course.inspected_m();
        let scores = course.runs.iter().map(|&(score, _)| f64::from(score)).filter(|score| score.is_finite());
        self.lowest = scores.chain(self.lowest).min_by(f64::total_cmp);
        course.highest_around(|score, lines| {
            let step = (f64::from(score) * STEPS_PER_SCORE).ceil() as i64;
            *self.by_step.entry(step).or_default() += course.metres(lines);
        });
    }

    /// The least threshold, in steps, that asks for at most so many metres to re-inspect per 100 m of inspected rope. `None` if nothing
    /// was inspected.
    pub fn threshold_for(&self, reinspect_m_per_100m: f64) -> Option<f64> {
        let lowest = self.lowest?;
        let mut reinspect_m = 0.0;
        for (&step, metres) in self.by_step.iter().rev() {
            reinspect_m += metres;
            if reinspect_m * 100.0 > reinspect_m_per_100m * self.inspected_m {
                return Some(step as f64 / STEPS_PER_SCORE);
            }
        }
        Some(lowest - 1.0) // all lines are alarms, and the budget allows it
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn course(views: &[&[(f32, usize)]]) -> ScoreCourse {
        let files = views.iter().map(|runs| {
            let scores = runs.iter().flat_map(|&(score, lines)| vec![score; lines]);
            std::io::Cursor::new(scores.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())
        });
        ScoreCourse::read(files.collect(), 0.1).unwrap()
    }

    #[test]
    fn any_view_raises_an_alarm_and_what_no_view_saw_is_not_inspected() {
        let course = course(&[&[(1.0, 500), (6.0, 10), (f32::NAN, 490)], &[(f32::NAN, 505), (7.0, 10), (1.0, 85)]]);
        assert!((course.inspected_m() - 0.06).abs() < 1e-12);
        let judged = course.judge(5.0);
        assert_eq!(judged.places, [Place { first_line: 500, last_line: 514, peak_score: 7.0 }]);
        assert!((judged.reinspect_m - 0.0515).abs() < 1e-12, "15 lines and 250 on either side, inspected or not");
        assert_eq!(course.judge(7.0).places, []);
    }

    #[test]
    fn alarms_far_apart_are_places_of_their_own() {
        let course = course(&[&[(1.0, 100), (6.0, 10), (1.0, 30), (6.0, 10), (1.0, 500), (6.0, 10)]]);
        let judged = course.judge(5.0);
        assert_eq!(judged.places.len(), 2, "3 mm apart is one place, 50 mm are two");
        assert!((judged.reinspect_m - 0.066).abs() < 1e-12, "all of it: gaps and contexts are looked at too, once");
    }

    #[test]
    fn a_budget_gives_the_least_threshold_that_keeps_it() {
        // 1 of 100 m over 8, 3 of 100 m over 4; 5 cm of context to each place.
        let course = course(&[&[(1.0, 600_000), (9.0, 10_000), (1.0, 200_000), (5.0, 20_000), (1.0, 170_000)]]);
        assert_eq!(course.inspected_m(), 100.0);
        let mut metres = MetresToLookAt::default();
        assert_eq!(metres.threshold_for(1.0), None, "nothing was inspected");
        metres.add(&course);
        let thresholds = [0.0, 3.0, 3.2, 101.0].map(|budget| metres.threshold_for(budget).unwrap());
        assert_eq!(thresholds, [9.0, 5.0, 1.0, 0.0], "the last one allows all of the rope");
    }

    #[test]
    fn a_threshold_for_a_budget_keeps_it_as_inspections_judge_and_a_step_lower_does_not() {
        // Scores from -2 to 8, most of them low, with gaps, in runs of up to 40 lines; two camera lines of different lengths.
        let mut chance = ChaCha8Rng::seed_from_u64(1);
        let mut random = || chance.random::<f32>();
        let mut runs = || -> Vec<(f32, usize)> {
            let mut run = || {
                let lines = 1 + (40.0 * random()) as usize;
                (if random() < 0.1 { f32::NAN } else { 10.0 * random().powi(8) - 2.0 }, lines)
            };
            (0..2000).map(|_| run()).collect()
        };
        let courses = [course(&[&runs()]), ScoreCourse { pitch_mm: 0.25, ..course(&[&runs()]) }];
        let mut metres = MetresToLookAt::default();
        courses.iter().for_each(|course| metres.add(course));
        let inspected_m: f64 = courses.iter().map(ScoreCourse::inspected_m).sum();
        let asked_for = |threshold| {
            let reinspect_m: f64 = courses.iter().map(|course| course.judge(threshold).reinspect_m).sum();
            100.0 * reinspect_m / inspected_m
        };
        // Sums of metres differ by rounding only.
        for budget in [0.0, 0.7, 3.0, 11.0, 40.0, 90.0] {
            let threshold = metres.threshold_for(budget).unwrap();
            let (kept, lower) = (asked_for(threshold), asked_for(threshold - 1.0 / STEPS_PER_SCORE));
            assert!(kept <= budget + 1e-9 && lower > budget - 1e-9, "{threshold}: {kept} and {lower} of {budget}");
        }
    }

    #[test]
    fn what_is_kept_for_a_budget_grows_with_the_range_of_scores_and_not_with_the_rope() {
        let rising: Vec<(f32, usize)> = (0..60_000_u16).map(|n| (f32::from(n) / 60_000.0, 1)).collect();
        let rising = course(&[&rising]);
        assert_eq!(rising.runs.len(), 60_000);
        let mut metres = MetresToLookAt::default();
        (0..3).for_each(|_| metres.add(&rising));
        assert!(metres.by_step.len() <= 4097, "{} steps from 0 to 1", metres.by_step.len());
    }
}
