//! How many defects have a report of their own: two defects at one metre that are reported as one get one ticket.
//!
//! Everywhere else a report finds what it touches along the rope, whatever it takes for its cause. Here it also has to lie at the columns of the
//! label, and stands for one defect only.

use super::defects::{ReportedAlarm, ReportedDefect};
use super::labels::{MARGIN_LINES, Run, Sighting};
use petgraph::algo::maximum_matching;
use petgraph::graph::UnGraph;
use std::collections::{BTreeMap, BTreeSet};

/// Columns beside a label in which an alarm still is at its place: labels end where an expert saw the damage end.
const MARGIN_COLUMNS: usize = 12;

/// Most of the defects `of` that can have a reported defect each. Where labels or alarms have no columns, lines decide.
pub(super) fn told_apart(reported: &[ReportedDefect], sightings: &[Sighting], of: &BTreeSet<usize>) -> usize {
    let mut pairs: UnGraph<(), ()> = UnGraph::new_undirected();
    let defects: BTreeMap<usize, _> = of.iter().map(|&defect| (defect, pairs.add_node(()))).collect();
    for report in reported {
        let node = pairs.add_node(());
        let at_its_place = |sighting: &&Sighting| {
            let alarms = report.alarms.iter().filter(|alarm| alarm.view == sighting.view);
            alarms
                .flat_map(|alarm| sighting.runs.iter().map(move |run| (alarm, run)))
                .any(|(alarm, run)| meet(alarm, run))
        };
        let places: BTreeSet<usize> = sightings.iter().filter(at_its_place).map(|sighting| sighting.defect).collect();
        for defect in places.iter().filter_map(|defect| defects.get(defect)) {
            pairs.add_edge(*defect, node, ());
        }
    }
    maximum_matching(&pairs).len()
}

/// Whether an alarm is where a label is.
fn meet(alarm: &ReportedAlarm, run: &Run) -> bool {
    let overlap = |a: (usize, usize), b: (usize, usize), margin: usize| a.0 <= b.1 + margin && b.0 <= a.1 + margin;
    let columns = alarm.first_column.zip(alarm.last_column).zip(run.columns);
    overlap((alarm.first_line, alarm.last_line), run.lines, MARGIN_LINES)
        && columns.is_none_or(|(alarm, label)| overlap(alarm, label, MARGIN_COLUMNS))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sighting(defect: usize, columns: Option<(usize, usize)>) -> Sighting {
        let runs = vec![Run { lines: (100, 120), columns }];
        let (kind, lines) = ("notch".into(), (100..=120).collect());
        Sighting { defect, kind, severity: 1.0, view: 0, first_line: 100, last_line: 120, clear: true, runs, lines }
    }

    fn report(columns: (usize, usize)) -> ReportedDefect {
        let (first_column, last_column) = (Some(columns.0), Some(columns.1));
        ReportedDefect {
            alarms: vec![ReportedAlarm { view: 0, first_line: 105, last_line: 160, first_column, last_column }],
        }
    }

    #[test]
    fn a_report_at_the_columns_of_two_defects_stands_for_one_of_them() {
        let sightings = [sighting(3, Some((40, 60))), sighting(5, Some((200, 230)))];
        let of = BTreeSet::from([3, 5]);
        assert_eq!(told_apart(&[report((45, 50))], &sightings, &of), 1);
        assert_eq!(told_apart(&[report((45, 210))], &sightings, &of), 1);
        assert_eq!(told_apart(&[report((45, 50)), report((50, 72))], &sightings, &of), 1, "both at the first");
        assert_eq!(
            told_apart(&[report((45, 210)), report((50, 72))], &sightings, &of),
            2,
            "the wide one is left for the second"
        );
        assert_eq!(told_apart(&[report((45, 50)), report((188, 190))], &sightings, &of), 2);
        assert_eq!(told_apart(&[report((45, 50)), report((180, 187))], &sightings, &of), 1, "beyond the margin");
        assert_eq!(
            told_apart(&[report((45, 50)), report((200, 210))], &sightings, &BTreeSet::from([5])),
            1,
            "of those asked for"
        );
    }

    #[test]
    fn without_columns_lines_decide() {
        let sightings = [sighting(3, None), sighting(5, None)];
        assert_eq!(told_apart(&[report((0, 1)), report((400, 410))], &sightings, &BTreeSet::from([3, 5])), 2);
    }
}
