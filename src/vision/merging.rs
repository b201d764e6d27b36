//! From alarms to defects: alarms of one cause, merged over lines, wires, strands and views.

use super::defects::{ALARM_GAP_MM, Alarm, Defect};

/// Alarms of one strand nearer than this along the rope have one cause.
const DEFECT_GAP_MM: f64 = 15.0;
/// Alarms of one wire nearer than this have one cause: on the inner side of its strand nobody sees it. So have those of the wires beside it:
/// where one is missing, what shows may be taken for its neighbour.
const WIRE_GAP_MM: f64 = 40.0;
/// Alarms on different strands that are farther apart round the rope have nothing to do with each other. A choice: half way from one strand of
/// six to the next, because damage on the border of two strands lies near to it in both.
const ONE_PLACE_RAD: f64 = std::f64::consts::FRAC_PI_6;

/// How far behind an alarm may end and still be joined by one that comes later, in lines.
pub fn reach_lines(pitch_mm: f64) -> usize {
    ((ALARM_GAP_MM + WIRE_GAP_MM) / pitch_mm).ceil() as usize
}

/// Which alarms have one cause, on a rope whose strands have so many wires.
struct OneCause {
    wires: usize,
    gap_lines: usize,
    wire_gap_lines: usize,
}

impl OneCause {
    /// Whether an alarm and one that begins no sooner have one.
    fn have(&self, before: &Alarm, alarm: &Alarm) -> bool {
        let apart = alarm.first_line.saturating_sub(before.last_line);
        if before.strand == alarm.strand {
            let wires_apart = before.wire.abs_diff(alarm.wire);
            let beside = wires_apart.min(self.wires.abs_diff(wires_apart)) <= 1;
            apart <= if beside { self.wire_gap_lines } else { self.gap_lines }
        } else {
            let one_place = before.signs.apart_rad(&alarm.signs).is_none_or(|apart_rad| apart_rad <= ONE_PLACE_RAD);
            apart <= self.gap_lines / 3 && one_place
        }
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
/// place of the rope. A strand has so many wires. It takes time by the number of alarms, however many there are.
pub fn merge(mut alarms: Vec<Alarm>, wires: usize, pitch_mm: f64) -> Vec<Defect> {
    alarms.sort_by_key(begins);
    let lines = |mm: f64| (mm / pitch_mm).round() as usize;
    let one_cause = OneCause { wires, gap_lines: lines(DEFECT_GAP_MM), wire_gap_lines: lines(WIRE_GAP_MM) };
    let (mut growing, mut ended): (Vec<Growing>, Vec<Growing>) = (Vec::new(), Vec::new());
    for alarm in alarms {
        let reached = |a: &Alarm| a.last_line + one_cause.wire_gap_lines >= alarm.first_line;
        for defect in &mut growing {
            defect.behind.extend(defect.within_reach.extract_if(.., |a| !reached(a)));
        }
        ended.extend(growing.extract_if(.., |defect| defect.within_reach.is_empty()));
        let mut joined = Growing::default();
        let joins = |defect: &mut Growing| defect.within_reach.iter().any(|a| one_cause.have(a, &alarm));
        for defect in growing.extract_if(.., joins) {
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
    fn breaks_on_different_sides_of_the_rope_at_one_metre_are_two_defects() {
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
        assert_eq!(merge(vec![towards(0, 1, 0.5), towards(0, 2, 0.9)], 9, 0.1).len(), 1, "on their border");
        assert_eq!(merge(vec![towards(0, 1, -0.1), towards(0, 2, 0.9)], 9, 0.1).len(), 2, "on either strand");
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
    fn alarms_out_of_reach_still_belong_to_the_defect_that_goes_on_from_them() {
        // One strand from pass to pass, 3 m of it, while another strand has alarms of its own.
        let passes = (0..100).map(|pass| alarm(pass % 4, 300 * pass, 300 * pass + 150, 2, 15.0));
        let towards = |mut alarm: Alarm, angle: f64| {
            alarm.signs.direction = angle.sin_cos();
            alarm
        };
        let passes = passes.map(|alarm| towards(alarm, 0.0));
        let others = (0..10).map(|k| towards(alarm(1, 3000 * k, 3000 * k + 10, 5, 14.0), 2.0));
        let defects = merge(passes.chain(others).collect(), 9, 0.1);
        let counts: Vec<usize> = defects.iter().map(|defect| defect.alarms.len()).collect();
        assert_eq!(counts, [100, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]);
        assert!(defects[0].alarms.is_sorted_by_key(|alarm| alarm.first_line));
        assert_eq!((defects[0].first_line(), defects[0].last_line()), (0, 29_850));
    }
}
