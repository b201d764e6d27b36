//! Which metres of which view were inspected, and why others were not. Not covered is not intact.

use super::Acquisition;
use super::results::NotCovered;
use crate::vision::aligner::AlignedStretch;
use crate::vision::evidence::not_judged;
use crate::vision::lost_lines::{Loss, LostLines};
use crate::vision::stretch::ViewStretch;
use std::ops::Range;

/// Most gaps that are listed of a view: a camera that loses a line every centimetre has 40,000 on 400 m. Where there are more, those
/// nearest to each other are joined, and the rope between them does not count as covered.
const MOST_GAPS: usize = 1000;

/// Most reasons that one gap names.
const MOST_SAID: usize = 3;

/// Why lines were not inspected: some were lost, and the others cannot be judged without them, or something else, or both.
#[derive(Debug, Clone, Default, PartialEq)]
struct Why {
    /// So many of them were black, saturated, repeated.
    lost: [usize; 3],
    /// Other reasons, in words.
    said: Vec<String>,
    /// Whether there were more of these than are named.
    and_more: bool,
}

impl Why {
    fn lost(lost: [usize; 3]) -> Self {
        Self { lost, ..Self::default() }
    }

    fn said(reason: String) -> Self {
        Self { said: vec![reason], ..Self::default() }
    }

    /// Whether both are one cause: the same words, or lines lost however many.
    fn is_that_of(&self, other: &Self) -> bool {
        let lost = |why: &Self| why.lost != [0; 3];
        lost(self) == lost(other) && (&self.said, self.and_more) == (&other.said, other.and_more)
    }

    fn join(&mut self, other: &Self) {
        self.lost.iter_mut().zip(other.lost).for_each(|(n, more)| *n += more);
        self.and_more |= other.and_more;
        for reason in &other.said {
            if self.said.contains(reason) {
                continue;
            }
            if self.said.len() < MOST_SAID { self.said.push(reason.clone()) } else { self.and_more = true }
        }
    }

    fn in_words(&self) -> String {
        let lost: Vec<(usize, &str)> =
            self.lost.iter().copied().zip(["black", "saturated", "repeated"]).filter(|(n, _)| *n > 0).collect();
        let n: usize = self.lost.iter().sum();
        let how = match &lost[..] {
            [(_, how)] => (*how).to_owned(),
            several => several.iter().map(|(n, how)| format!("{n} {how}")).collect::<Vec<_>>().join(", "),
        };
        let lines = (n > 0).then(|| format!("{n} {} lost: {how}", if n == 1 { "line" } else { "lines" }));
        let more = self.and_more.then(|| "other reasons".to_owned());
        lines.into_iter().chain(self.said.iter().cloned()).chain(more).collect::<Vec<_>>().join("; ")
    }
}

/// Lines of a view that were not inspected.
#[derive(Debug, Clone, PartialEq)]
struct Gap {
    lines: Range<usize>,
    why: Why,
}

/// What is known of one view.
#[derive(Debug, Default)]
struct ViewCoverage {
    covered_lines: usize,
    gaps: Vec<Gap>,
    /// Gaps of one cause that are no farther apart are one. Grows where there are too many; then those of several causes are joined, too.
    joined_lines: usize,
}

/// Metres that were inspected, and those that were not, with reasons; neighbours with one reason are joined.
#[derive(Debug)]
pub(super) struct Coverage {
    views: Vec<ViewCoverage>,
}

impl Coverage {
    /// Nothing is known of so many views.
    pub fn new(views: usize) -> Self {
        Self { views: (0..views).map(|_| ViewCoverage::default()).collect() }
    }

    /// Adds the next stretch: every line of it in every view is covered or not.
    pub fn add(&mut self, stretch: &AlignedStretch, pitch_mm: f64) {
        for (view, seen) in self.views.iter_mut().zip(&stretch.views) {
            let not_aligned = not_aligned(stretch, seen);
            let at = |lines: Range<usize>| stretch.first_line + lines.start..stretch.first_line + lines.end;
            let others = |view: &mut ViewCoverage, lines: Range<usize>| match &not_aligned {
                Some(reason) => view.leave_out(Gap { lines: at(lines), why: Why::said(reason.clone()) }),
                None => view.covered_lines += lines.len(),
            };
            let mut from = 0;
            for lines in not_judged(&seen.lost, seen.image.lines(), pitch_mm) {
                others(view, from..lines.start);
                from = lines.end;
                view.leave_out(Gap { why: lost(&seen.lost, &lines), lines: at(lines) });
            }
            others(view, from..stretch.lines);
        }
    }

    /// Metres times views that were inspected, and those that were not, along the rope.
    pub fn finish(self, acquisition: &Acquisition) -> (f64, Vec<NotCovered>) {
        let lines: usize = self.views.iter().map(|view| view.covered_lines).sum();
        let mut rows: Vec<NotCovered> = Vec::new();
        for (view, coverage) in self.views.iter().enumerate() {
            rows.extend(coverage.gaps.iter().map(|gap| NotCovered {
                view,
                from_m: acquisition.position_m(gap.lines.start),
                to_m: acquisition.position_m(gap.lines.end),
                reason: gap.why.in_words(),
            }));
        }
        rows.sort_by(|a, b| a.from_m.total_cmp(&b.from_m).then(a.view.cmp(&b.view)));
        (lines as f64 * acquisition.line_pitch_mm / 1000.0, rows)
    }
}

impl ViewCoverage {
    fn leave_out(&mut self, gap: Gap) {
        if gap.lines.is_empty() {
            return;
        }
        if !self.join_to_last(&gap, false) {
            self.gaps.push(gap);
        }
        while self.gaps.len() > MOST_GAPS {
            self.joined_lines = (2 * self.joined_lines).max(1);
            for gap in std::mem::take(&mut self.gaps) {
                if !self.join_to_last(&gap, true) {
                    self.gaps.push(gap);
                }
            }
        }
    }

    /// True if the gap is part of the last one now. Causes that differ are joined only where that is asked for.
    fn join_to_last(&mut self, gap: &Gap, of_any_cause: bool) -> bool {
        let Some(last) = self.gaps.last_mut() else { return false };
        let apart = gap.lines.start - last.lines.end;
        if apart > self.joined_lines || !(of_any_cause || last.why.is_that_of(&gap.why)) {
            return false;
        }
        self.covered_lines -= apart;
        last.lines.end = gap.lines.end;
        last.why.join(&gap.why);
        true
    }
}

/// Why a view of a stretch was not inspected where its lines were not lost; `None` if it was.
fn not_aligned(stretch: &AlignedStretch, seen: &ViewStretch) -> Option<String> {
    let (lines, left) = (seen.image.lines(), seen.lines_seen());
    match &stretch.estimates {
        Ok(estimates) if seen.usable() => without_wires(&estimates.strands_without_wires()),
        _ if lines == 0 => Some("this view has no lines here".to_owned()),
        _ if seen.lost_too_many() => {
            Some(format!("only {left} of {lines} lines are there, which are too few to align"))
        }
        Ok(_) => Some("this view does not show both edges of the rope here".to_owned()),
        Err(reason) => Some(reason.to_string()),
    }
}

/// Why a stretch was not inspected on which the wires of these strands were not found; `None` if there are no such strands.
fn without_wires(strands: &[usize]) -> Option<String> {
    let named = strands.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    match strands {
        [] => None,
        [_] => Some(format!("the wires of strand {named} were not found here, so it was not judged")),
        _ => Some(format!("the wires of strands {named} were not found here, so they were not judged")),
    }
}

/// Why lines that were lost, and lines with them, are not judged.
fn lost(lost: &LostLines, lines: &Range<usize>) -> Why {
    let mut counts = [0; 3];
    for run in lost.within(lines.clone()) {
        let n = run.lines.end.min(lines.end) - run.lines.start.max(lines.start);
        match run.loss {
            Loss::Black => counts[0] += n,
            Loss::Saturated => counts[1] += n,
            Loss::Repeated => counts[2] += n,
            Loss::Ended => return Why::said("this view has no lines here".to_owned()),
        }
    }
    Why::lost(counts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gap(lines: Range<usize>, why: Why) -> Gap {
        Gap { lines, why }
    }

    fn said(view: &ViewCoverage) -> Vec<(Range<usize>, String)> {
        view.gaps.iter().map(|gap| (gap.lines.clone(), gap.why.in_words())).collect()
    }

    #[test]
    fn neighbours_with_one_reason_are_one_and_lost_lines_are_counted() {
        let mut view = ViewCoverage::default();
        view.leave_out(gap(100..105, Why::lost([1, 0, 0])));
        view.leave_out(gap(200..300, Why::lost([96, 0, 0])));
        view.leave_out(gap(300..400, Why::lost([90, 0, 3])));
        view.leave_out(gap(400..400, Why::lost([0, 0, 0])));
        view.leave_out(gap(400..500, Why::said("no rope".into())));
        view.leave_out(gap(500..600, Why::said("no rope".into())));
        let expected = [
            (100..105, "1 line lost: black"),
            (200..400, "189 lines lost: 186 black, 3 repeated"),
            (400..600, "no rope"),
        ];
        assert_eq!(said(&view), expected.map(|(lines, why)| (lines, why.to_owned())));
    }

    #[test]
    fn a_camera_that_loses_lines_all_the_time_fills_no_list_and_hides_nothing() {
        let mut view = ViewCoverage::default();
        let lines = 40_000 * 100;
        for n in 0..40_000 {
            view.leave_out(gap(100 * n..100 * n + 5, Why::lost([0, 0, 1])));
            view.covered_lines += 95;
        }
        assert!(view.gaps.len() <= MOST_GAPS, "{}", view.gaps.len());
        let left_out: usize = view.gaps.iter().map(|gap| gap.lines.len()).sum();
        assert_eq!((view.gaps[0].lines.start, view.covered_lines + left_out), (0, lines));
        assert_eq!(said(&view)[0].1, "40000 lines lost: repeated");
    }

    #[test]
    fn however_many_gaps_of_changing_causes_there_are_the_list_stays_short() {
        let mut view = ViewCoverage::default();
        for n in 0..5000 {
            let why = match n % 3 {
                0 => Why::said(format!("the contours agree only {:.2}", f64::from(n as u32) / 5000.0)),
                1 => Why::lost([1, 0, 0]),
                _ => Why::said("no rope".into()),
            };
            view.leave_out(gap(10 * n..10 * n + 10, why));
        }
        assert!(view.gaps.len() <= MOST_GAPS, "{}", view.gaps.len());
        assert_eq!(view.gaps.iter().map(|gap| gap.lines.len()).sum::<usize>(), 50_000);
        let first = said(&view)[0].1.clone();
        assert!(first.contains("lost: black") && first.contains("no rope") && first.contains("agree only"), "{first}");
    }

    #[test]
    fn strands_that_were_not_judged_are_named() {
        assert_eq!(without_wires(&[]), None);
        let one = without_wires(&[3]).unwrap();
        assert_eq!(one, "the wires of strand 3 were not found here, so it was not judged");
        assert!(without_wires(&[0, 5]).unwrap().starts_with("the wires of strands 0, 5 were"));
    }
}
