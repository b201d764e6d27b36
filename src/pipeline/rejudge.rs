//! What another threshold would decide: from stored line scores, without looking at the rope again.
//!
//! Stored scores do not tell strands apart, so alarms of two strands at one place count as one place here.

use super::reinspection::lines_to_look_at;
use crate::vision::defects::{AlarmBuilder, Look, merge};
use crate::vision::stretch_scores::StretchScores;
use std::io::Read;

/// Halvings of the interval of scores in search of a budget: finer than any score is told.
const HALVINGS: usize = 40;

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
                builder.add(first_line, lines, &one_block(score, first_line, lines), 1.0, |_| Look::default());
            }
            first_line += lines;
        }
        let alarms = builder.finish();
        let extents = alarms.iter().map(|a| (a.first_line, a.last_line));
        let reinspect_m = self.metres(lines_to_look_at(extents, self.pitch_mm, first_line));
        let places = merge(alarms, self.pitch_mm)
            .iter()
            .map(|d| Place {
                first_line: d.first_line(),
                last_line: d.last_line(),
                peak_score: d.peak().map_or(threshold, |p| p.peak_score),
            })
            .collect();
        Judgement { reinspect_m, places }
    }
}

/// Line scores know no wires: every run counts as one of its own, so that none are joined from pass to pass of a wire.
fn one_block(score: f32, first_line: usize, lines: usize) -> StretchScores {
    StretchScores {
        cells: Vec::new(),
        added: Vec::new(),
        looks: Vec::new(),
        seen: Vec::new(),
        blocks: vec![score],
        peaks: vec![(0, first_line)],
        block_lines: lines,
        places: 1,
    }
}

/// The least threshold that asks for at most so many metres to re-inspect per 100 m of inspected rope. `None` if nothing was.
pub fn threshold_for(courses: &[ScoreCourse], reinspect_m_per_100m: f64) -> Option<f64> {
    let inspected_m: f64 = courses.iter().map(ScoreCourse::inspected_m).sum();
    let scores = courses.iter().flat_map(|c| &c.runs).map(|(score, _)| f64::from(*score)).filter(|s| s.is_finite());
    let (mut low, mut high) = scores.fold(None, |range: Option<(f64, f64)>, s| {
        Some(range.map_or((s, s), |(low, high)| (low.min(s), high.max(s))))
    })?;
    low -= 1.0; // under it all lines are alarms
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.0;
        let reinspect_m: f64 = courses.iter().map(|c| c.judge(middle).reinspect_m).sum();
        if reinspect_m * 100.0 <= reinspect_m_per_100m * inspected_m { high = middle } else { low = middle }
    }
    Some(high)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let threshold = |budget| threshold_for(std::slice::from_ref(&course), budget).unwrap();
        assert!((threshold(3.0) - 5.0).abs() < 1e-6, "{}", threshold(3.0));
        assert!((threshold(3.2) - 1.0).abs() < 1e-6);
        assert!((threshold(0.0) - 9.0).abs() < 1e-6);
        assert_eq!(threshold_for(&[], 1.0), None);
    }
}
