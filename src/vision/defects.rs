//! From scores to alarms: runs of lines in which a strand is over the threshold; and what alarms of one cause say together.

use super::kind::{Figures, Signs};
use super::stretch_scores::{Peak, StretchScores};

/// Alarms of one strand in one view nearer than this along the rope are one.
pub(super) const ALARM_GAP_MM: f64 = 4.0;

/// A run of lines of one view in which a strand is over the threshold.
#[derive(Debug, Clone, PartialEq)]
pub struct Alarm {
    /// The view.
    pub view: usize,
    /// First line.
    pub first_line: usize,
    /// Last line.
    pub last_line: usize,
    /// First column.
    pub first_column: usize,
    /// Last column.
    pub last_column: usize,
    /// Highest score of the strand.
    pub peak_score: f64,
    /// The strand.
    pub strand: usize,
    /// Wire where the peak stands.
    pub wire: usize,
    /// What it shows.
    pub signs: Signs,
    /// Sine and cosine of the direction round the rope that it points to at its first and at its last line; 0 if that is not known.
    pub ends: [(f64, f64); 2],
}

/// What a strand over the threshold shows in a block.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Look {
    /// First and last column over the threshold, or nearest to the place that is.
    pub columns: (usize, usize),
    /// What they show.
    pub signs: Signs,
}

/// Alarms of one cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Defect {
    /// Its alarms, along the rope.
    pub alarms: Vec<Alarm>,
}

impl Defect {
    /// First line.
    pub fn first_line(&self) -> usize {
        self.alarms.iter().map(|a| a.first_line).min().unwrap_or(0)
    }

    /// Last line.
    pub fn last_line(&self) -> usize {
        self.alarms.iter().map(|a| a.last_line).max().unwrap_or(0)
    }

    /// The alarm with the highest score.
    pub fn peak(&self) -> Option<&Alarm> {
        self.alarms.iter().max_by(|a, b| a.peak_score.total_cmp(&b.peak_score))
    }

    /// What the view with the peak shows of it on its strand, and how much of other strands; a wire that stands out may show at the edge of any
    /// view.
    pub fn figures(&self) -> Option<Figures> {
        let peak = self.peak()?;
        let in_view = || self.alarms.iter().filter(|alarm| alarm.view == peak.view);
        let mut signs = Signs::default();
        in_view().filter(|alarm| alarm.strand == peak.strand).for_each(|alarm| signs.join(&alarm.signs));
        let area_mm2 = in_view().map(|alarm| alarm.signs.area_mm2).sum();
        let beyond_outline_mm = self.alarms.iter().map(|alarm| alarm.signs.beyond_outline_mm).fold(0.0, f64::max);
        Signs { area_mm2, beyond_outline_mm, ..signs }.figures()
    }
}

/// Collects the alarms of one view over consecutive stretches.
#[derive(Debug)]
pub struct AlarmBuilder {
    view: usize,
    threshold: f64,
    gap_lines: usize,
    /// Those that may still grow, one a strand at the most.
    open: Vec<Alarm>,
    done: Vec<Alarm>,
}

impl AlarmBuilder {
    /// Lines with a score above `threshold` are alarms.
    pub fn new(view: usize, threshold: f64, pitch_mm: f64) -> Self {
        let gap_lines = (ALARM_GAP_MM / pitch_mm).round() as usize;
        Self { view, threshold, gap_lines, open: Vec::new(), done: Vec::new() }
    }

    /// Adds the scores of a stretch. `look(block, peak)` answers what a strand over the threshold shows; it is asked for these only.
    pub fn add(
        &mut self,
        first_line: usize,
        lines: usize,
        scores: &StretchScores,
        wires_per_place: f64,
        mut look: impl FnMut(usize, Peak) -> Look,
    ) {
        for (block, _) in scores.blocks.iter().enumerate().filter(|(_, score)| f64::from(**score) > self.threshold) {
            let from = first_line + block * scores.block_lines;
            let to = (from + scores.block_lines - 1).min(first_line + lines - 1);
            let (ended, open): (Vec<_>, _) =
                self.open.drain(..).partition(|open| from > open.last_line + self.gap_lines);
            self.done.extend(ended);
            self.open = open;
            for peak in scores.peaks_over(block, self.threshold) {
                let Look { columns: (first_column, last_column), signs } = look(block, peak);
                let here = Alarm {
                    view: self.view,
                    first_line: from,
                    last_line: to,
                    first_column,
                    last_column,
                    peak_score: f64::from(peak.score),
                    strand: peak.strand,
                    wire: (peak.place as f64 * wires_per_place) as usize,
                    signs,
                    ends: [signs.direction; 2],
                };
                match self.open.iter_mut().find(|open| open.strand == peak.strand) {
                    Some(open) => open.grow(here),
                    None => self.open.push(here),
                }
            }
        }
    }

    /// Alarms so far that begin at `line` or later; the last ones may still grow.
    pub fn since(&self, line: usize) -> impl Iterator<Item = &Alarm> {
        self.done.iter().chain(&self.open).filter(move |alarm| alarm.first_line >= line)
    }

    /// All alarms.
    pub fn finish(mut self) -> Vec<Alarm> {
        self.done.extend(self.open);
        self.done
    }
}

impl Alarm {
    /// Angle round the rope, 0 to pi, between the places that two alarms point to at a line; `None` if either is not known.
    pub fn apart_rad(&self, other: &Self, line: usize) -> Option<f64> {
        let ((sin, cos), (other_sin, other_cos)) = (self.towards(line), other.towards(line));
        let lengths = sin.hypot(cos) * other_sin.hypot(other_cos);
        (lengths > 0.0).then(|| ((sin * other_sin + cos * other_cos) / lengths).clamp(-1.0, 1.0).acos())
    }

    /// The direction at a line: between those at its ends, for a strand winds.
    fn towards(&self, line: usize) -> (f64, f64) {
        let lines = (self.last_line - self.first_line).max(1) as f64;
        let share = (line.saturating_sub(self.first_line) as f64 / lines).min(1.0);
        let [(sin, cos), (last_sin, last_cos)] = self.ends;
        (sin + share * (last_sin - sin), cos + share * (last_cos - cos))
    }

    /// Goes on with what follows it.
    fn grow(&mut self, next: Self) {
        self.last_line = next.last_line;
        self.first_column = self.first_column.min(next.first_column);
        self.last_column = self.last_column.max(next.last_column);
        self.signs.join(&next.signs);
        self.ends[1] = next.ends[1];
        if next.peak_score > self.peak_score {
            (self.peak_score, self.wire) = (next.peak_score, next.wire);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_over_the_threshold_form_alarms_across_stretches() {
        let scores = |blocks: Vec<f32>| StretchScores {
            added: Vec::new(),
            looks: Vec::new(),
            cells: Vec::new(),
            visibility: Vec::new(),
            peaks: vec![(1, 7); blocks.len()],
            blocks,
            block_lines: 5,
            places: 45,
        };
        let mut builder = AlarmBuilder::new(0, 4.0, 0.1);
        let shows = |columns| move |_, _| Look { columns, ..Look::default() };
        builder.add(0, 20, &scores(vec![1.0, 2.0, 3.0, 6.0]), 0.2, shows((10, 12)));
        builder.add(20, 20, &scores(vec![5.0, f32::NAN, 1.0, 1.0]), 0.2, shows((8, 11)));
        builder.add(2000, 10, &scores(vec![9.0, 1.0]), 0.2, shows((7, 7)));
        let alarms = builder.finish();
        assert_eq!(alarms.len(), 2);
        assert_eq!((alarms[0].first_line, alarms[0].last_line), (15, 24));
        assert_eq!((alarms[0].first_column, alarms[0].last_column, alarms[0].wire), (8, 12, 1));
    }

    #[test]
    fn a_gap_beside_a_longer_defect_of_another_strand_is_an_alarm_of_its_own() {
        // Three strands of ten places in 60 blocks: the first over the threshold everywhere, the last in two blocks.
        let mut cells = vec![1.0f32; 60 * 30];
        (0..60).for_each(|block| cells[block * 30 + 4] = 30.0);
        (20..22).for_each(|block| cells[block * 30 + 27] = 15.0);
        let scores = StretchScores {
            added: Vec::new(),
            looks: Vec::new(),
            cells,
            visibility: Vec::new(),
            peaks: vec![(0, 4); 60],
            blocks: vec![30.0; 60],
            block_lines: 5,
            places: 10,
        };
        let mut builder = AlarmBuilder::new(0, 12.0, 0.1);
        builder.add(1000, 300, &scores, 0.2, |_, _| Look::default());
        let alarms = builder.finish();
        let extents: Vec<_> = alarms.iter().map(|a| (a.first_line, a.last_line, a.strand)).collect();
        assert_eq!(extents, [(1100, 1109, 2), (1000, 1299, 0)], "those that end first come first");
    }
}
