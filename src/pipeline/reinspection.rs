//! How much rope a person looks at who follows up alarms: one count for budgets and previews. Evaluations count the same on their own:
//! who judges results shares no code with who made them.

/// Rope that a person needs to see to judge one alarm, in mm: half of it on either side. [Wacker13, sec. 6.4]
pub(super) const CONTEXT_MM: f64 = 50.0;

/// Lines on each side of an alarm that belong to its context.
pub(super) fn context_lines(line_pitch_mm: f64) -> usize {
    (CONTEXT_MM / 2.0 / line_pitch_mm) as usize
}

/// Lines to look at: alarms given by first and last line, with their context, each line once. The rope ends before
/// line `rope_lines`.
pub(super) fn lines_to_look_at(
    alarms: impl IntoIterator<Item = (usize, usize)>,
    line_pitch_mm: f64,
    rope_lines: usize,
) -> usize {
    let context = context_lines(line_pitch_mm);
    let mut intervals: Vec<(usize, usize)> = alarms
        .into_iter()
        .map(|(first, last)| (first.saturating_sub(context), (last + 1 + context).min(rope_lines)))
        .collect();
    intervals.sort_unstable();
    let (mut lines, mut end) = (0, 0);
    for (from, to) in intervals {
        lines += to.saturating_sub(from.max(end));
        end = end.max(to);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contexts_that_overlap_count_once_and_end_with_the_rope() {
        let count = |alarms: &[(usize, usize)]| lines_to_look_at(alarms.iter().copied(), 0.1, 10_000);
        assert_eq!(count(&[]), 0);
        assert_eq!(count(&[(5000, 5009)]), 510, "10 lines and 25 mm on either side");
        assert_eq!(count(&[(5005, 5019), (5000, 5009)]), 520);
        assert_eq!(count(&[(1000, 1009), (9999, 9999)]), 510 + 251);
        assert_eq!(count(&[(40, 49)]), 300);
    }
}
