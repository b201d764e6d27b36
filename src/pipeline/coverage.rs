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

/// Why lines were not inspected.
#[derive(Debug, Clone, PartialEq)]
enum Why {
    /// So many of them were black, saturated, repeated; the others cannot be judged without them.
    Lost([usize; 3]),
    /// Something else.
    Said(String),
}

impl Why {
    /// The same cause, if both are one.
    fn joined(&self, other: &Self) -> Option<Self> {
        match (self, other) {
            (Self::Lost(a), Self::Lost(b)) => Some(Self::Lost(std::array::from_fn(|k| a[k] + b[k]))),
            _ => (self == other).then(|| self.clone()),
        }
    }

    fn in_words(&self) -> String {
        let counts = match self {
            Self::Said(reason) => return reason.clone(),
            Self::Lost(counts) => counts,
        };
        let lost: Vec<(usize, &str)> =
            counts.iter().copied().zip(["black", "saturated", "repeated"]).filter(|(n, _)| *n > 0).collect();
        let n: usize = counts.iter().sum();
        let how = match &lost[..] {
            [(_, how)] => (*how).to_owned(),
            several => several.iter().map(|(n, how)| format!("{n} {how}")).collect::<Vec<_>>().join(", "),
        };
        format!("{n} {} lost: {how}", if n == 1 { "line" } else { "lines" })
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
    /// Gaps of one cause that are no farther apart are one. Grows where there are too many.
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
                Some(reason) => view.leave_out(Gap { lines: at(lines), why: Why::Said(reason.clone()) }),
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
        if !self.join_to_last(&gap) {
            self.gaps.push(gap);
        }
        while self.gaps.len() > MOST_GAPS {
            self.joined_lines = (2 * self.joined_lines).max(1);
            for gap in std::mem::take(&mut self.gaps) {
                if !self.join_to_last(&gap) {
                    self.gaps.push(gap);
                }
            }
        }
    }

    /// True if the gap is part of the last one now.
    fn join_to_last(&mut self, gap: &Gap) -> bool {
        let Some(last) = self.gaps.last_mut() else { return false };
        let apart = gap.lines.start - last.lines.end;
        match last.why.joined(&gap.why) {
            Some(why) if apart <= self.joined_lines => {
                self.covered_lines -= apart;
                (last.lines.end, last.why) = (gap.lines.end, why);
                true
            }
            _ => false,
        }
    }
}

/// Why a view of a stretch was not inspected where its lines were not lost; `None` if it was.
fn not_aligned(stretch: &AlignedStretch, seen: &ViewStretch) -> Option<String> {
    let (lines, left) = (seen.image.lines(), seen.lines_seen());
    match &stretch.estimates {
        Ok(_) if seen.usable() => None,
        _ if lines == 0 => Some("this view has no lines here".to_owned()),
        _ if seen.lost_too_many() => {
            Some(format!("only {left} of {lines} lines are there, which are too few to align"))
        }
        Ok(_) => Some("this view does not show both edges of the rope here".to_owned()),
        Err(reason) => Some(reason.to_string()),
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
            Loss::Ended => return Why::Said("this view has no lines here".to_owned()),
        }
    }
    Why::Lost(counts)
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
        view.leave_out(gap(100..105, Why::Lost([1, 0, 0])));
        view.leave_out(gap(200..300, Why::Lost([96, 0, 0])));
        view.leave_out(gap(300..400, Why::Lost([90, 0, 3])));
        view.leave_out(gap(400..400, Why::Lost([0, 0, 0])));
        view.leave_out(gap(400..500, Why::Said("no rope".into())));
        view.leave_out(gap(500..600, Why::Said("no rope".into())));
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
            view.leave_out(gap(100 * n..100 * n + 5, Why::Lost([0, 0, 1])));
            view.covered_lines += 95;
        }
        assert!(view.gaps.len() <= MOST_GAPS, "{}", view.gaps.len());
        let left_out: usize = view.gaps.iter().map(|gap| gap.lines.len()).sum();
        assert_eq!((view.gaps[0].lines.start, view.covered_lines + left_out), (0, lines));
        assert_eq!(said(&view)[0].1, "40000 lines lost: repeated");
    }
}
