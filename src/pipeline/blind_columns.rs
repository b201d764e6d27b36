//! How much of the rope's width a view does not judge, because columns of its sensor say nothing. Not judged is not intact.

use super::Acquisition;
use crate::vision::aligner::AlignedStretch;
use crate::vision::contour::Contours;
use crate::vision::stretch::ViewStretch;
use std::ops::Range;

/// Share of the rope's width from which on it is told, a choice. Strands pass every column alike, so it is the share of what the view shows
/// that is not judged, all along: 1 % weighs as much as 1 m in 100 m that was not covered, and is an eighth of the width of a wire of
/// 6x9 rope. One stuck column takes two on either side with it, which are 1.3 % of a rope 380 columns wide.
const LEAST_SHARE: f64 = 0.01;

/// Columns of the rope that one view does not judge.
#[derive(Debug, Clone, PartialEq)]
struct Blind {
    /// Most of them in a stretch.
    columns: usize,
    /// Columns of the rope there.
    rope_columns: usize,
    /// From the first stretch that has enough of them to the last.
    lines: Range<usize>,
}

/// Columns of the rope that are not judged, view by view.
#[derive(Debug)]
pub(super) struct BlindColumns {
    /// `None` for a view that has so few that they are not told.
    views: Vec<Option<Blind>>,
}

impl BlindColumns {
    /// Nothing is known of so many views.
    pub fn new(views: usize) -> Self {
        Self { views: vec![None; views] }
    }

    /// Adds the next stretch that is judged. Views that are not aligned there are not covered anyway.
    pub fn add(&mut self, stretch: &AlignedStretch) {
        if stretch.estimates.is_err() {
            return;
        }
        let lines = stretch.first_line..stretch.first_line + stretch.lines;
        for (view, seen) in stretch.views.iter().enumerate().filter(|(_, seen)| seen.usable()) {
            self.see(view, seen, lines.clone());
        }
    }

    fn see(&mut self, view: usize, seen: &ViewStretch, lines: Range<usize>) {
        let Some(rope) = rope_columns(&seen.contours) else { return };
        let of_rope = |blind: &Range<usize>| blind.end.min(rope.end).saturating_sub(blind.start.max(rope.start));
        let columns: usize = seen.blind.iter().map(of_rope).sum();
        if columns == 0 || (columns as f64) < LEAST_SHARE * rope.len() as f64 {
            return;
        }
        let rope_columns = rope.len();
        let blind = self.views[view].get_or_insert(Blind { columns, rope_columns, lines: lines.clone() });
        blind.lines.end = lines.end;
        if columns > blind.columns {
            (blind.columns, blind.rope_columns) = (columns, rope_columns);
        }
    }

    /// What a person should know, a sentence for each view that does not judge all of the rope's width.
    pub fn notes(&self, acquisition: &Acquisition) -> Vec<String> {
        let note = |(view, blind): (usize, &Option<Blind>)| {
            let Blind { columns, rope_columns, lines } = blind.as_ref()?;
            let percent = 100.0 * *columns as f64 / *rope_columns as f64;
            let (from_m, to_m) = (acquisition.position_m(lines.start), acquisition.position_m(lines.end));
            Some(format!(
                "view {view}: up to {columns} of the {rope_columns} columns of the rope's width ({percent:.1} %) are not judged between \
                 metre {from_m:.2} and {to_m:.2}, because its sensor says nothing there, and what passes them is not known to be intact: \
                 clean or replace the camera"
            ))
        };
        self.views.iter().enumerate().filter_map(note).collect()
    }
}

/// Columns from edge to edge of the rope, on average over the lines that show both; `None` if none does.
fn rope_columns(contours: &Contours) -> Option<Range<usize>> {
    let both = contours.lower_px.iter().zip(&contours.upper_px).filter(|(l, u)| l.is_finite() && u.is_finite());
    let (lower, upper, lines) = both.fold((0.0f64, 0.0f64, 0.0f64), |(lower, upper, lines), (l, u)| {
        (lower + f64::from(*l), upper + f64::from(*u), lines + 1.0)
    });
    let column = |sum: f64| (sum / lines).round().max(0.0) as usize;
    (lines > 0.0).then(|| column(lower)..column(upper) + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::training_range::tests::acquisition;

    /// A rope in columns 50 to 449.
    fn seen(blind: &[Range<usize>]) -> ViewStretch {
        let contours = Contours { lower_px: vec![f32::NAN, 49.0, 51.0], upper_px: vec![448.0, 449.0, 449.0] };
        ViewStretch { blind: blind.to_vec(), contours, ..ViewStretch::default() }
    }

    #[test]
    fn a_view_that_does_not_judge_a_hundredth_of_the_width_is_named_with_columns_and_metres() {
        let mut blind = BlindColumns::new(2);
        blind.see(0, &seen(&[]), 0..2000);
        blind.see(0, &seen(&[148..153, 460..465]), 2000..4000);
        blind.see(0, &seen(&[148..155, 258..263]), 4000..6000);
        blind.see(0, &seen(&[258..263, 460..465]), 6000..8000);
        blind.see(1, &seen(&[20..25, 447..452]), 0..2000); // three of the rope
        let notes = blind.notes(&acquisition(|_| ()));
        let words = "view 0: up to 12 of the 400 columns of the rope's width (3.0 %) are not judged between metre 100.20 and 100.80, because";
        assert!(notes.len() == 1 && notes[0].starts_with(words), "{notes:?}");
        assert!(notes[0].ends_with("clean or replace the camera"));
    }

    #[test]
    fn a_view_that_shows_no_rope_tells_nothing() {
        let mut blind = BlindColumns::new(1);
        blind.see(0, &ViewStretch { contours: Contours::default(), ..seen(&[148..153, 200..205]) }, 0..2000);
        assert_eq!(blind.notes(&acquisition(|_| ())), Vec::<String>::new());
    }
}
