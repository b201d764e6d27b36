//! What an inspection has found while it still runs. Lay lengths of a stretch are what the tables will show; defects near the end
//! of what was seen may still grow or join.

use super::Acquisition;
use super::detection::defect_row;
use super::results::{DefectRow, LayLengthRow};
use crate::vision::defects::{Alarm, AlarmBuilder};
use crate::vision::merging::{OneCause, merge, reach_lines};

/// What one or more stretches brought.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Lay lengths of the stretches, fused and of each view.
    pub lay_lengths: Vec<LayLengthRow>,
    /// What is new among the defects; `None`: nothing is.
    pub defects: Option<FoundDefects>,
}

/// Defects that are new or have changed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FoundDefects {
    /// Number of the first that may have changed; all that were told from this number on hold no more.
    pub from: usize,
    /// The defects from there on.
    pub rows: Vec<DefectRow>,
}

/// Defects of an inspection that still runs. Those that nothing can join any more are settled: they have their final number, and
/// their alarms are not merged again with every stretch.
#[derive(Debug, Default)]
pub(super) struct DefectsSoFar {
    settled: usize,
    settled_line: usize,
}

impl DefectsSoFar {
    /// Looks at the alarms of all views when everything before `next_line` was taken.
    pub fn look(&mut self, acquisition: &Acquisition, builders: &[AlarmBuilder], next_line: usize) -> FoundDefects {
        let alarms: Vec<Alarm> = builders.iter().flat_map(|b| b.since(self.settled_line)).cloned().collect();
        let defects = merge(alarms, &OneCause::on(&acquisition.rope, acquisition.line_pitch_mm));
        let reach = reach_lines(acquisition.line_pitch_mm);
        // From where on alarms are looked at again: no defect may lie on both sides, for numbers follow the rope.
        let mut open_from = next_line;
        for defect in defects.iter().rev() {
            let grows = defect.last_line() + reach >= next_line;
            if grows || defect.alarms.iter().any(|alarm| alarm.first_line >= open_from) {
                open_from = open_from.min(defect.first_line());
            }
        }
        let rows = (self.settled..).zip(&defects).map(|(n, d)| defect_row(acquisition, n, d)).collect();
        let found = FoundDefects { from: self.settled, rows };
        self.settled += defects.iter().filter(|d| d.first_line() < open_from).count();
        self.settled_line = open_from;
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::acquisition::{RopeFile, ViewFile};
    use crate::vision::defects::Look;
    use crate::vision::stretch_scores::StretchScores;

    fn acquisition() -> Acquisition {
        let file = RopeFile {
            strands: 6,
            wires_per_strand: 9,
            rope_diameter_mm: 20.46,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
            line_pitch_mm: 0.1,
            rope_width_px: None,
            sensor_px: 480,
            views: vec![ViewFile { folder: "view0".into(), angle_deg: 0.0, px_per_mm: None }],
            start_m: None,
            ropeway: None,
            rope: None,
            acquired_at: None,
        };
        file.validate().unwrap()
    }

    /// Blocks of 5 lines, alarmed where `over` says so.
    fn scores(first_line: usize, lines: usize, over: impl Fn(usize) -> bool) -> StretchScores {
        let blocks: Vec<f32> = (0..lines / 5).map(|b| if over(first_line + 5 * b) { 9.0 } else { 1.0 }).collect();
        let peaks = vec![(1, 7); blocks.len()];
        StretchScores {
            cells: Vec::new(),
            added: Vec::new(),
            looks: Vec::new(),
            visibility: Vec::new(),
            peaks,
            blocks,
            block_lines: 5,
            places: 45,
        }
    }

    #[test]
    fn what_was_told_stretch_by_stretch_adds_up_to_the_defects_of_the_whole() {
        let acquisition = acquisition();
        // One inside a stretch, one over a cut, two that lie too far apart to be one, one at the end.
        let over = |line: usize| matches!(line, 100..160 | 950..1040 | 1500..1510 | 2200..2210 | 3980..4000);
        let mut builders = vec![AlarmBuilder::new(0, 4.0, 0.1)];
        let (mut so_far, mut told) = (DefectsSoFar::default(), Vec::new());
        let mut most = 0;
        for first_line in (0..4000).step_by(1000) {
            let scores = scores(first_line, 1000, over);
            builders[0].add(first_line, 1000, &scores, 0.2, |_, _| Look::default());
            let found = so_far.look(&acquisition, &builders, first_line + 1000);
            told.truncate(found.from);
            told.extend(found.rows.clone());
            most = most.max(found.rows.len());
            if first_line == 0 {
                assert_eq!(told.len(), 2, "a defect that still grows is told at once");
                assert!(told[1].to_m < 0.101, "as far as it was seen: {:?}", told[1]);
            }
        }
        let whole = merge(builders.pop().unwrap().finish(), &OneCause::on(&acquisition.rope, 0.1));
        let whole: Vec<DefectRow> = whole.iter().enumerate().map(|(n, d)| defect_row(&acquisition, n, d)).collect();
        assert_eq!(told, whole);
        assert_eq!(whole.len(), 5);
        assert!(most < whole.len(), "settled defects are not told again");
    }
}
