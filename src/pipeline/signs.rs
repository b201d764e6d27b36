//! Looks at an alarmed strand in a block: which columns are over the threshold, and what they show.

use crate::vision::appearance::{Appearance, GrayScale};
use crate::vision::defects::Look;
use crate::vision::inspection_model::AlignedView;
use crate::vision::kind::{Grays, Signs};
use crate::vision::model_contour::ModelContour;
use crate::vision::stretch_scores::{Peak, StretchScores};
use crate::vision::surface_map::{PLACES_PER_WIRE, SurfaceMap};

/// Rope to either side over which the edge's usual distance from the outline is taken, in mm: farther than a wire stands out.
const OUTLINE_MM: f64 = 60.0;
/// Every so many lines of it are looked at.
const OUTLINE_EVERY: usize = 10;
/// Distance along the rope over which gray is compared, in mm.
const GRAIN_MM: f64 = 0.3;

/// Looks at the alarmed blocks of one view of a stretch.
pub(super) struct Looker<'a> {
    seen: AlignedView<'a>,
    scores: &'a StretchScores,
    gray: &'a Appearance,
    /// Made for the first alarm: most stretches have none.
    tools: Option<Tools<'a>>,
}

/// What looking takes.
struct Tools<'a> {
    scale: GrayScale,
    contour: ModelContour,
    map: SurfaceMap<'a>,
}

impl<'a> Looker<'a> {
    /// For a view; `gray` is what its model expects.
    pub fn new(seen: AlignedView<'a>, scores: &'a StretchScores, gray: &'a Appearance) -> Self {
        Self { seen, scores, gray, tools: None }
    }

    /// What a strand over the threshold shows in the middle line of a block. Its highest place may lie just beside what that line shows: then
    /// nothing is told but where that is.
    pub fn look(&mut self, block: usize, Peak { strand, place, .. }: Peak, threshold: f64) -> Look {
        let (seen, scores, gray) = (self.seen, self.scores, self.gray);
        let camera = seen.camera;
        let Tools { scale, contour, map } = self.tools.get_or_insert_with(|| {
            let half_width_px = camera.px_per_mm * seen.rope.diameter_mm() / 2.0;
            let scale = GrayScale::new(&seen.view.image, &seen.view.axis_px, half_width_px);
            Tools { scale, contour: ModelContour::new(seen.rope, camera), map: seen.surface_map() }
        });
        let line = (block * scores.block_lines + scores.block_lines / 2).min(seen.view.image.lines() - 1);
        let past = line.saturating_sub((GRAIN_MM / seen.pitch_mm).round().max(1.0) as usize);
        let (row, bins) = (seen.view.image.line(line), scale.fine(line));
        let (past_row, past_bins) = (seen.view.image.line(past), scale.fine(past));
        let first = block * seen.rope.strands() * scores.places;
        // A block may be over the threshold by its neighbours' help: then its highest place stands for it.
        let limit = (threshold as f32).min(scores.cells[first + strand * scores.places + place]);
        let apart = |other: usize| {
            let apart = other.abs_diff(place);
            apart.min(scores.places - apart)
        };
        let mut columns = Columns::default();
        let mut over_places = vec![false; scores.places];
        let (mut wire, mut beside, mut over) = (Grays::default(), Grays::default(), 0.0);
        map.for_each(line, seen.view.axis_px[line], |point| {
            let at = |row: &[u8], bins: &[f32; 256]| bins[usize::from(row[point.column])];
            let here = at(row, bins);
            let deviation = f64::from(here - gray.expected_at(point.theta, point.cell));
            let change = f64::from((here - at(past_row, past_bins)).abs());
            let on_strand = point.strand == strand;
            let on_wire = on_strand && apart(point.place) <= PLACES_PER_WIRE / 2;
            if deviation.is_finite() {
                if on_wire { wire.add(deviation, change) } else { beside.add(deviation, change) }
            }
            let is_over = on_strand && scores.cells[first + strand * scores.places + point.place] >= limit;
            if is_over {
                over += 1.0;
                over_places[point.place] = true;
            }
            if on_strand {
                columns.add(point.column, apart(point.place), is_over);
            }
        });
        let (direction, column) = towards(&seen, line, strand, columns.of_peak());
        let Some(columns) = columns.over else {
            return Look { columns: (column, column), signs: Signs { direction, ..Signs::default() } };
        };
        let length_mm = scores.block_lines as f64 * seen.pitch_mm;
        let wires = over_places.iter().filter(|over| **over).count() as f64 / PLACES_PER_WIRE as f64;
        Look {
            columns,
            signs: Signs {
                length_mm,
                mm_wires: length_mm * wires,
                area_mm2: length_mm * over / camera.px_per_mm,
                wire,
                beside,
                beyond_outline_mm: beyond_outline_mm(&seen, contour, line, strand),
                direction,
                likely: scores.likely(block, strand),
            },
        }
    }
}

/// Columns of a line that show a strand.
#[derive(Default)]
struct Columns {
    /// First and last that are over the threshold.
    over: Option<(usize, usize)>,
    /// Those nearest to the peak: how many places away, the sum of them, and their number.
    nearest: Option<(usize, f64, f64)>,
}

impl Columns {
    fn add(&mut self, column: usize, places_from_peak: usize, over: bool) {
        if over {
            self.over = Some(self.over.map_or((column, column), |(a, b)| (a.min(column), b.max(column))));
        }
        // All of the wire is as near as can be.
        let away = places_from_peak.saturating_sub(PLACES_PER_WIRE / 2);
        match &mut self.nearest {
            Some((nearest, ..)) if *nearest < away => {}
            Some((nearest, sum, n)) if *nearest == away => (*sum, *n) = (*sum + column as f64, *n + 1.0),
            nearest => *nearest = Some((away, column as f64, 1.0)),
        }
    }

    /// Where the peak is, or what is shown of the strand nearest to it.
    fn of_peak(&self) -> Option<f64> {
        self.nearest.map(|(_, sum, n)| sum / n)
    }
}

/// Sine and cosine of the direction round the rope of what a column shows, and that column. A strand that other views show may just be out of
/// sight in this one: then it lies where it was found to be.
fn towards(seen: &AlignedView<'_>, line: usize, strand: usize, column: Option<f64>) -> ((f64, f64), usize) {
    let (axis_px, camera) = (f64::from(seen.view.axis_px[line]), seen.camera);
    let radius_px = camera.px_per_mm * seen.rope.diameter_mm() / 2.0;
    let aside_rad = match column {
        Some(column) => ((column - axis_px) / radius_px).clamp(-1.0, 1.0).asin(),
        None => strand_phase_rad(seen, line, strand) - camera.angle_rad,
    };
    let column = column.unwrap_or(axis_px + radius_px * aside_rad.sin()) as usize;
    ((camera.angle_rad + aside_rad).sin_cos(), column.min(seen.view.image.width() - 1))
}

/// How far the rope's edge on a strand's side is outside the model's outline, beyond what it usually is about there; 0 where it is not seen, and
/// for a strand that faces the camera, because others make the outline.
fn beyond_outline_mm(seen: &AlignedView<'_>, contour: &ModelContour, line: usize, strand: usize) -> f64 {
    let aside = (strand_phase_rad(seen, line, strand) - seen.camera.angle_rad).sin();
    if aside.abs() < (seen.rope.strand_step_rad() / 2.0).sin() {
        return 0.0;
    }
    let edge = |(lower, upper): (f64, f64)| if aside < 0.0 { lower } else { upper };
    let reach = (OUTLINE_MM / seen.pitch_mm) as usize;
    let lines = line.saturating_sub(reach)..(line + reach + 1).min(seen.view.image.lines());
    let beyond = |line: usize| edge(outside_px(seen, contour, line));
    let mut about: Vec<f64> = lines.step_by(OUTLINE_EVERY).map(beyond).filter(|px| px.is_finite()).collect();
    about.sort_by(f64::total_cmp);
    let px = about.get(about.len() / 2).map_or(0.0, |usual| beyond(line) - usual);
    if px.is_finite() { px.max(0.0) / seen.camera.px_per_mm } else { 0.0 }
}

/// How far the lower and the upper edge are outside the outline of the model; NaN where they were not seen.
fn outside_px(seen: &AlignedView<'_>, contour: &ModelContour, line: usize) -> (f64, f64) {
    let phase = strand_phase_rad(seen, line, 0) - seen.camera.angle_rad;
    let edge = |edges: &[f32]| edges.get(line).map_or(f64::NAN, |&e| f64::from(e - seen.view.axis_px[line]));
    if !phase.is_finite() {
        return (f64::NAN, f64::NAN);
    }
    let (lower, upper) = (edge(&seen.view.contours.lower_px), edge(&seen.view.contours.upper_px));
    let (model_lower, model_upper) = contour.edges_px(phase);
    (model_lower - lower, upper - model_upper)
}

/// Phase of a strand at a line, in rope axes; NaN if it is not known.
fn strand_phase_rad(seen: &AlignedView<'_>, line: usize, strand: usize) -> f64 {
    let knot = line / seen.estimates.knot_lines.max(1);
    let phases = &seen.estimates.strand_phases_rad;
    phases.get(knot * seen.rope.strands() + strand).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_is_where_its_wire_is_or_what_is_nearest_to_it_on_its_strand() {
        let mut columns = Columns::default();
        assert_eq!(columns.of_peak(), None);
        columns.add(90, 9, false);
        assert_eq!((columns.of_peak(), columns.over), (Some(90.0), None));
        (100..=104).zip([2, 1, 0, 1, 2]).for_each(|(column, away)| columns.add(column, away, away == 1));
        columns.add(105, 3, true);
        assert_eq!((columns.of_peak(), columns.over), (Some(102.0), Some((101, 105))));
    }
}
