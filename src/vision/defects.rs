//! From scores to alarms to defects: runs of lines over the threshold, merged over lines, wires and views.

use super::kind::{Figures, Signs};
use super::stretch_scores::StretchScores;

/// Alarms of one view nearer than this along the rope are one.
const ALARM_GAP_MM: f64 = 4.0;
/// Alarms of one strand nearer than this along the rope have one cause.
const DEFECT_GAP_MM: f64 = 15.0;
/// Alarms of one wire nearer than this have one cause: on the inner side of its strand nobody sees it. So have those of the wires beside it:
/// where one is missing, what shows may be taken for its neighbour.
const WIRE_GAP_MM: f64 = 40.0;
/// Alarms of two views on different strands that are farther apart round the rope have nothing to do with each other. A choice: half way
/// between one place, which two cameras tell of alike, and opposite sides, which no two cameras share.
const VIEWS_AGREE_RAD: f64 = std::f64::consts::FRAC_PI_2;

/// A run of lines of one view over the threshold.
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
    /// Highest line score.
    pub peak_score: f64,
    /// Strand where the peak stands.
    pub strand: usize,
    /// Wire where the peak stands.
    pub wire: usize,
    /// What it shows.
    pub signs: Signs,
}

/// What a block over the threshold shows.
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

    /// What the view with the peak shows of it; a wire that stands out may show at the edge of any view.
    pub fn figures(&self) -> Option<Figures> {
        let view = self.peak()?.view;
        let mut signs = Signs::default();
        self.alarms.iter().filter(|alarm| alarm.view == view).for_each(|alarm| signs.join(&alarm.signs));
        let beyond = self.alarms.iter().map(|alarm| alarm.signs.beyond_outline_mm).fold(0.0, f64::max);
        Signs { beyond_outline_mm: beyond, ..signs }.figures()
    }
}

/// Collects the alarms of one view over consecutive stretches.
#[derive(Debug)]
pub struct AlarmBuilder {
    view: usize,
    threshold: f64,
    gap_lines: usize,
    open: Option<Alarm>,
    done: Vec<Alarm>,
}

impl AlarmBuilder {
    /// Lines with a score above `threshold` are alarms.
    pub fn new(view: usize, threshold: f64, pitch_mm: f64) -> Self {
        Self { view, threshold, gap_lines: (ALARM_GAP_MM / pitch_mm).round() as usize, open: None, done: Vec::new() }
    }

    /// Adds the scores of a stretch. `look(block)` answers what a block over the threshold shows; it is asked for alarmed blocks only.
    pub fn add(
        &mut self,
        first_line: usize,
        lines: usize,
        scores: &StretchScores,
        wires_per_place: f64,
        mut look: impl FnMut(usize) -> Look,
    ) {
        for (block, &score) in scores.blocks.iter().enumerate() {
            let score = f64::from(score);
            if score.is_nan() || score <= self.threshold {
                continue;
            }
            let from = first_line + block * scores.block_lines;
            let to = (from + scores.block_lines - 1).min(first_line + lines - 1);
            let (strand, place) = scores.peaks[block];
            let Look { columns: (first_column, last_column), signs } = look(block);
            let wire = (place as f64 * wires_per_place) as usize;
            match &mut self.open {
                Some(open) if from <= open.last_line + self.gap_lines => {
                    open.last_line = to;
                    open.first_column = open.first_column.min(first_column);
                    open.last_column = open.last_column.max(last_column);
                    open.signs.join(&signs);
                    if score > open.peak_score {
                        (open.peak_score, open.strand, open.wire) = (score, strand, wire);
                    }
                }
                open => {
                    self.done.extend(open.take());
                    *open = Some(Alarm {
                        view: self.view,
                        first_line: from,
                        last_line: to,
                        first_column,
                        last_column,
                        peak_score: score,
                        strand,
                        wire,
                        signs,
                    });
                }
            }
        }
    }

    /// Alarms so far that begin at `line` or later; the last one may still grow.
    pub fn since(&self, line: usize) -> impl Iterator<Item = &Alarm> {
        let settled = self.done.partition_point(|alarm| alarm.first_line < line);
        self.done[settled..].iter().chain(self.open.as_ref().filter(move |open| open.first_line >= line))
    }

    /// All alarms.
    pub fn finish(mut self) -> Vec<Alarm> {
        self.done.extend(self.open);
        self.done
    }
}

/// How far behind an alarm may end and still be joined by one that comes later, in lines.
pub fn reach_lines(pitch_mm: f64) -> usize {
    ((ALARM_GAP_MM + WIRE_GAP_MM) / pitch_mm).ceil() as usize
}

/// Merges alarms into defects: those of one wire and its neighbours from pass to pass, of one strand nearby, and of different views at the
/// same place of the rope. A strand has so many wires.
pub fn merge(mut alarms: Vec<Alarm>, wires: usize, pitch_mm: f64) -> Vec<Defect> {
    alarms.sort_by_key(|a| (a.first_line, a.view));
    let lines = |mm: f64| (mm / pitch_mm).round() as usize;
    let (gap_lines, wire_gap_lines) = (lines(DEFECT_GAP_MM), lines(WIRE_GAP_MM));
    let mut defects: Vec<Defect> = Vec::new();
    for alarm in alarms {
        let near = |a: &Alarm| {
            let apart = alarm.first_line.saturating_sub(a.last_line);
            if a.strand == alarm.strand {
                let wires_apart = a.wire.abs_diff(alarm.wire);
                apart <= if wires_apart.min(wires.abs_diff(wires_apart)) <= 1 { wire_gap_lines } else { gap_lines }
            } else {
                let one_place = a.signs.apart_rad(&alarm.signs).is_none_or(|apart_rad| apart_rad <= VIEWS_AGREE_RAD);
                apart <= gap_lines / 3 && a.view != alarm.view && one_place
            }
        };
        let mut joined = Defect { alarms: vec![alarm.clone()] };
        let mut k = 0;
        while k < defects.len() {
            if defects[k].alarms.iter().any(near) {
                joined.alarms.splice(0..0, defects.remove(k).alarms);
            } else {
                k += 1;
            }
        }
        defects.push(joined);
    }
    defects.sort_by_key(Defect::first_line);
    defects
}

#[cfg(test)]
mod tests {
    use super::*;

    fn alarm(view: usize, first_line: usize, last_line: usize, strand: usize, peak_score: f64) -> Alarm {
        Alarm {
            view,
            first_line,
            last_line,
            first_column: 0,
            last_column: 1,
            peak_score,
            strand,
            wire: 0,
            signs: Signs::default(),
        }
    }

    #[test]
    fn one_break_seen_by_two_views_is_one_defect_and_another_strand_far_away_is_not() {
        let alarms = vec![alarm(0, 100, 150, 2, 5.0), alarm(1, 110, 160, 2, 7.0), alarm(0, 5000, 5010, 2, 6.0)];
        let defects = merge(alarms, 9, 0.1);
        assert_eq!(defects.len(), 2);
        assert_eq!(defects[0].alarms.len(), 2);
        assert_eq!(defects[0].peak().unwrap().view, 1);
        assert_eq!((defects[0].first_line(), defects[0].last_line()), (100, 160));
    }

    #[test]
    fn breaks_on_opposite_sides_of_the_rope_at_one_metre_are_two_defects() {
        let towards = |view, strand, angle: f64| {
            let signs = Signs { direction: angle.sin_cos(), ..Signs::default() };
            Alarm { signs, ..alarm(view, 100, 130, strand, 15.0) }
        };
        assert_eq!(merge(vec![towards(0, 1, 0.2), towards(2, 4, 3.3)], 9, 0.1).len(), 2);
        assert_eq!(
            merge(vec![towards(0, 1, 0.7), towards(1, 2, 1.0)], 9, 0.1).len(),
            1,
            "both see one place between them"
        );
    }

    #[test]
    fn a_missing_wire_is_one_defect_although_nobody_sees_it_between_its_passes() {
        let of_wire = |first_line, wire| Alarm { wire, ..alarm(0, first_line, first_line + 300, 3, 15.0) };
        let passes = [of_wire(48400, 2), of_wire(49020, 2), of_wire(49680, 2)];
        assert_eq!(merge(passes.to_vec(), 9, 0.1).len(), 1);
        // A neighbour may stand for it, also where numbers begin again.
        assert_eq!(merge(vec![of_wire(48400, 0), of_wire(49020, 8), of_wire(49680, 0)], 9, 0.1).len(), 1);
        // Another wire of the strand that far away is another matter, and so is the same one farther away.
        assert_eq!(merge(vec![of_wire(48400, 2), of_wire(49020, 5)], 9, 0.1).len(), 2);
        assert_eq!(merge(vec![of_wire(48400, 2), of_wire(49200, 2)], 9, 0.1).len(), 2);
    }

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
        let shows = |columns| move |_| Look { columns, ..Look::default() };
        builder.add(0, 20, &scores(vec![1.0, 2.0, 3.0, 6.0]), 0.2, shows((10, 12)));
        builder.add(20, 20, &scores(vec![5.0, f32::NAN, 1.0, 1.0]), 0.2, shows((8, 11)));
        builder.add(2000, 10, &scores(vec![9.0, 1.0]), 0.2, shows((7, 7)));
        let alarms = builder.finish();
        assert_eq!(alarms.len(), 2);
        assert_eq!((alarms[0].first_line, alarms[0].last_line), (15, 24));
        assert_eq!((alarms[0].first_column, alarms[0].last_column, alarms[0].wire), (8, 12, 1));
    }
}
