//! What an aligner has to know of an acquisition.

use super::rope::Rope;

/// Up to so many views leave gaps in which nobody sees a strand.
const MOST_VIEWS_WITH_GAPS: usize = 2;
/// Millimetres of rope per knot, in rope diameters: a fraction of a wire's pitch.
const KNOT_DIAMETERS: f64 = 0.15;
/// Fewest readings of a knot, and most lines from one to the next: with half as many lay lengths are no better.
const KNOT_READINGS: usize = 4;
const MOST_READING_LINES: usize = 8;

/// Rope in strand lays, and the lay in diameters where none is given, after which the mean gray of a column says more of the sensor than
/// of single wires.
const COLUMN_LAYS: f64 = 3.0;
const USUAL_LAY_DIAMETERS: f64 = 7.0;

/// What does not change over an acquisition.
#[derive(Debug, Clone)]
pub struct AlignerSpec {
    /// The rope.
    pub rope: Rope,
    /// Rope per camera line in mm.
    pub pitch_mm: f64,
    /// Angles of the views in rad.
    pub view_angles_rad: Vec<f64>,
    /// Columns of the images.
    pub width_px: usize,
    /// Expected width of the rope in px, if known.
    pub rope_width_px: Option<f64>,
    /// Scale of each view in px/mm at the rope axis where somebody measured it, else empty: diameters are absolute then.
    pub calibrated_px_per_mm: Vec<f64>,
    /// Lines from one reading of the wires to the next: neighbouring lines tell nearly the same.
    pub reading_lines: usize,
    /// Lines per knot of the courses.
    pub knot_lines: usize,
}

impl AlignerSpec {
    /// A specification with knots suited to the rope.
    pub fn new(
        rope: Rope,
        pitch_mm: f64,
        view_angles_rad: Vec<f64>,
        width_px: usize,
        rope_width_px: Option<f64>,
    ) -> Self {
        let knot_lines = (KNOT_DIAMETERS * rope.diameter_mm() / pitch_mm).round() as usize;
        let knot_lines = knot_lines.max(2 * KNOT_READINGS).next_multiple_of(KNOT_READINGS);
        let reading_lines = (knot_lines / KNOT_READINGS).min(MOST_READING_LINES);
        let calibrated_px_per_mm = Vec::new();
        Self {
            rope,
            pitch_mm,
            view_angles_rad,
            width_px,
            rope_width_px,
            calibrated_px_per_mm,
            reading_lines,
            knot_lines,
        }
    }

    /// True if some view sees every strand everywhere: fewer leave gaps, over which the count of a strand's wires is the first concern.
    pub(super) fn sees_all_round(&self) -> bool {
        self.view_angles_rad.len() > MOST_VIEWS_WITH_GAPS
    }

    /// Fewest lines that teach the columns of the sensor.
    pub(super) fn column_lines(&self) -> usize {
        let usual_mm = USUAL_LAY_DIAMETERS * self.rope.diameter_mm();
        let lay_mm = self.rope.design().strand_lay_mm.map_or(usual_mm, f64::abs);
        (COLUMN_LAYS * lay_mm / self.pitch_mm) as usize
    }

    /// Lines of a stretch: whole knots, about `lines`.
    pub fn stretch_lines(&self, lines: usize) -> usize {
        (lines / self.knot_lines).max(4) * self.knot_lines
    }
}
