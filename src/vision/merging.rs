//! From alarms to defects: alarms of one cause, merged over lines, wires, strands and views.

use super::defects::{ALARM_GAP_MM, Alarm, Defect};
use super::rope::Rope;

/// Alarms of one strand nearer than this along the rope have one cause.
const DEFECT_GAP_MM: f64 = 15.0;
/// Alarms of one wire nearer than this have one cause: on the inner side of its strand nobody sees it. So have those of the wires beside it:
/// where one is missing, what shows may be taken for its neighbour.
const WIRE_GAP_MM: f64 = 40.0;

/// How far behind an alarm may end and still be joined by one that comes later, in lines.
pub fn reach_lines(pitch_mm: f64) -> usize {
    ((ALARM_GAP_MM + WIRE_GAP_MM) / pitch_mm).ceil() as usize
}

/// Which alarms have one cause.
#[derive(Debug, Clone, Copy)]
pub struct OneCause {
    wires: usize,
    gap_lines: usize,
    wire_gap_lines: usize,
    one_place_rad: f64,
}

impl OneCause {
    /// Those of a rope. Alarms on different strands that are more than half a strand apart round it have nothing to do with each other, because
    /// damage on the border of two strands lies near to it in both.
    pub fn on(rope: &Rope, pitch_mm: f64) -> Self {
        Self { wires: rope.wires(), one_place_rad: rope.strand_step_rad() / 2.0, ..Self::of_runs(pitch_mm) }
    }

    /// Those of lines of which nothing is known but their scores: every run of them counts as a wire of its own.
    pub fn of_runs(pitch_mm: f64) -> Self {
        let lines = |mm: f64| (mm / pitch_mm).round() as usize;
        let (gap_lines, wire_gap_lines) = (lines(DEFECT_GAP_MM), lines(WIRE_GAP_MM));
        Self { wires: usize::MAX, gap_lines, wire_gap_lines, one_place_rad: 0.0 }
    }

    /// Whether an alarm and one that begins no sooner have one.
    fn have(&self, before: &Alarm, alarm: &Alarm) -> bool {
        let apart = alarm.first_line.saturating_sub(before.last_line);
        if before.strand == alarm.strand {
            let wires_apart = before.wire.abs_diff(alarm.wire);
            let beside = wires_apart.min(self.wires.abs_diff(wires_apart)) <= 1;
            return apart <= if beside { self.wire_gap_lines } else { self.gap_lines };
        }
        // Strands wind: what counts is where both point to at the lines that they share, or are nearest at.
        let line = usize::midpoint(alarm.first_line, alarm.last_line.min(before.last_line));
        let one_place = before.apart_rad(alarm, line).is_none_or(|apart_rad| apart_rad <= self.one_place_rad);
        apart <= self.gap_lines / 3 && one_place
    }
}

/// A defect that alarms to come may join.
#[derive(Default)]
struct Growing {
    /// Its alarms that are out of their reach.
    behind: Vec<Alarm>,
    /// The others.
    within_reach: Vec<Alarm>,
}

/// Where an alarm begins: what alarms and defects are sorted by.
fn begins(alarm: &Alarm) -> (usize, usize, usize) {
    (alarm.first_line, alarm.view, alarm.strand)
}

/// Merges alarms into defects: those of one wire and its neighbours from pass to pass, of one strand nearby, and of different strands at the same
/// place of the rope. It takes time by the number of alarms, however many there are.
pub fn merge(mut alarms: Vec<Alarm>, one_cause: &OneCause) -> Vec<Defect> {
    alarms.sort_by_key(begins);
    let (mut growing, mut ended): (Vec<Growing>, Vec<Growing>) = (Vec::new(), Vec::new());
    for alarm in alarms {
        let reached = |a: &Alarm| a.last_line + one_cause.wire_gap_lines >= alarm.first_line;
        for defect in &mut growing {
            defect.behind.extend(defect.within_reach.extract_if(.., |a| !reached(a)));
        }
        ended.extend(growing.extract_if(.., |defect| defect.within_reach.is_empty()));
        let joins = |defect: &mut Growing| defect.within_reach.iter().any(|a| one_cause.have(a, &alarm));
        let mut joining: Vec<Growing> = growing.extract_if(.., joins).collect();
        // The longest takes in the others, and none is copied for one more alarm.
        joining.sort_by_key(|defect| defect.behind.len());
        let mut joined = joining.pop().unwrap_or_default();
        for defect in joining {
            joined.behind.extend(defect.behind);
            joined.within_reach.extend(defect.within_reach);
        }
        joined.within_reach.push(alarm);
        growing.push(joined);
    }
    let whole = ended.into_iter().chain(growing).map(|Growing { mut behind, within_reach }| {
        behind.extend(within_reach);
        behind.sort_by_key(begins);
        Defect { alarms: behind }
    });
    let mut defects: Vec<Defect> = whole.collect();
    defects.sort_by_key(|defect| defect.alarms.first().map(begins));
    defects
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::kind::Signs;

    /// 6x9.
    fn usual() -> OneCause {
        OneCause { wires: 9, one_place_rad: std::f64::consts::FRAC_PI_6, ..OneCause::of_runs(0.1) }
    }

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
            ends: [(0.0, 0.0); 2],
        }
    }

    /// The same, pointing to an angle at its first line and to one at its last.
    fn towards(alarm: Alarm, first_rad: f64, last_rad: f64) -> Alarm {
        Alarm { ends: [first_rad.sin_cos(), last_rad.sin_cos()], ..alarm }
    }

    #[test]
    fn one_break_seen_by_two_views_is_one_defect_and_another_strand_far_away_is_not() {
        let alarms = vec![alarm(0, 100, 150, 2, 5.0), alarm(1, 110, 160, 2, 7.0), alarm(0, 5000, 5010, 2, 6.0)];
        let defects = merge(alarms, &usual());
        assert_eq!(defects.len(), 2);
        assert_eq!(defects[0].alarms.len(), 2);
        assert_eq!(defects[0].peak().unwrap().view, 1);
        assert_eq!((defects[0].first_line(), defects[0].last_line()), (100, 160));
    }

    #[test]
    fn breaks_on_different_sides_of_the_rope_at_one_metre_are_two_defects() {
        let at = |view, strand, angle| towards(alarm(view, 100, 130, strand, 15.0), angle, angle);
        assert_eq!(merge(vec![at(0, 1, 0.2), at(2, 4, 3.3)], &usual()).len(), 2);
        assert_eq!(merge(vec![at(0, 1, 0.7), at(1, 2, 1.0)], &usual()).len(), 1, "both see one place between them");
        assert_eq!(merge(vec![at(0, 1, 0.5), at(0, 2, 0.9)], &usual()).len(), 1, "on their border");
        assert_eq!(merge(vec![at(0, 1, -0.1), at(0, 2, 0.9)], &usual()).len(), 2, "on either strand");
    }

    #[test]
    fn where_a_long_alarm_points_to_is_asked_at_the_lines_of_the_other_one() {
        // It winds by 1.6 rad, while another one lies on the border to the next strand at its end, or a strand away there.
        let long = towards(alarm(0, 0, 600, 1, 15.0), 0.0, 1.6);
        let short = |angle| towards(alarm(0, 560, 600, 2, 15.0), angle, angle);
        assert_eq!(merge(vec![long.clone(), short(1.8)], &usual()).len(), 1);
        assert_eq!(merge(vec![long, short(0.8)], &usual()).len(), 2);
    }

    #[test]
    fn a_missing_wire_is_one_defect_although_nobody_sees_it_between_its_passes() {
        let of_wire = |first_line, wire| Alarm { wire, ..alarm(0, first_line, first_line + 300, 3, 15.0) };
        let passes = [of_wire(48400, 2), of_wire(49020, 2), of_wire(49680, 2)];
        assert_eq!(merge(passes.to_vec(), &usual()).len(), 1);
        // A neighbour may stand for it, also where numbers begin again.
        assert_eq!(merge(vec![of_wire(48400, 0), of_wire(49020, 8), of_wire(49680, 0)], &usual()).len(), 1);
        // Another wire of the strand that far away is another matter, and so is the same one farther away.
        assert_eq!(merge(vec![of_wire(48400, 2), of_wire(49020, 5)], &usual()).len(), 2);
        assert_eq!(merge(vec![of_wire(48400, 2), of_wire(49200, 2)], &usual()).len(), 2);
    }

    #[test]
    fn alarms_out_of_reach_still_belong_to_the_defect_that_goes_on_from_them() {
        // One strand from pass to pass, 3 m of it, while another strand has alarms of its own.
        let passes = (0..100).map(|pass| alarm(pass % 4, 300 * pass, 300 * pass + 150, 2, 15.0));
        let passes = passes.map(|alarm| towards(alarm, 0.0, 0.0));
        let others = (0..10).map(|k| towards(alarm(1, 3000 * k, 3000 * k + 10, 5, 14.0), 2.0, 2.0));
        let defects = merge(passes.chain(others).collect(), &usual());
        let counts: Vec<usize> = defects.iter().map(|defect| defect.alarms.len()).collect();
        assert_eq!(counts, [100, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]);
        assert!(defects[0].alarms.is_sorted_by_key(|alarm| alarm.first_line));
        assert_eq!((defects[0].first_line(), defects[0].last_line()), (0, 29_850));
    }
}
