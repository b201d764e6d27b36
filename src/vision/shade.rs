//! How bright the surface of a strand is on average, as its wires are read against: the [`Template`] with what is left of wires taken out.
//!
//! A template learnt from a metre of rope has seen some thirty strands pass, and their wires have not averaged out. What is left of
//! them is the same at every pass, while the wires are not: measured against it they seem turned to and fro by some hundredths of a
//! rad, and a pattern learnt from wires so measured leaves the template as it is. But along a strand, at one place of its outline, what
//! is left of wires repeats with every wire and the strand's own shade hardly changes: the mean over one wire's pitch is free of it.

use super::rope::Rope;
use super::surface::StrandSpan;
use super::template::{PHASE_BINS, Template};

/// Places across a strand's outline.
pub(super) const PLACES: usize = 64;
/// Added to the mean gray that readings are divided by: the dark between strands must not count the most.
const DARKEST: f32 = 0.05;
/// Wire pitches longer than this share of the table's turn of a strand would average over different views of it.
const LONGEST_TURN_RAD: f64 = 0.6;

/// Table of 1/(mean gray + `DARKEST`) by the phase in view of a strand and the place across its outline.
#[derive(Debug, Clone)]
pub struct Shade {
    width: usize,
    bins_per_rad: f64,
    /// Rows on either side of the phase 0.
    reach: isize,
    gain: Vec<f32>,
}

impl Shade {
    /// Averages a template over the pitch of wires that turn `wire_turns` times as fast as the strands; not at all where this is unknown.
    /// `farthest_rad` is the largest phase in view that is asked for.
    pub fn new(rope: &Rope, template: &Template, wire_turns: Option<f64>, farthest_rad: f64) -> Self {
        let bins_per_rad = PHASE_BINS as f64 / rope.strand_step_rad();
        let reach = (farthest_rad * bins_per_rad).ceil() as isize;
        let pitch_rad = wire_turns.map_or(0.0, |turns| rope.wire_step_rad() / turns.abs());
        let rows = if pitch_rad <= LONGEST_TURN_RAD { (pitch_rad * bins_per_rad).round() as isize } else { 1 };
        let (before, after) = ((rows.max(1) - 1) / 2, rows.max(1) / 2);
        let first = -reach - before;
        // Sums over the rows before each, of gray values and their number.
        let mut sums = vec![(0.0f32, 0.0f32); PLACES];
        for row in first..=reach + after {
            let from = sums.len() - PLACES;
            sums.extend_from_within(from..);
            if let Some((mean, span)) = seen(rope, template, row) {
                for (place, sum) in sums[from + PLACES..].iter_mut().enumerate() {
                    if let Some(gray) = gray(template.width(), mean, span, place) {
                        *sum = (sum.0 + gray, sum.1 + 1.0);
                    }
                }
            }
        }
        let mut gain = Vec::with_capacity((2 * reach as usize + 1) * PLACES);
        for row in 0..=2 * reach as usize {
            let (low, high) = (row * PLACES, (row + rows.max(1) as usize) * PLACES);
            let means = (0..PLACES).map(|place| {
                let (a, b) = (sums[low + place], sums[high + place]);
                (b.1 > a.1).then(|| (b.0 - a.0) / (b.1 - a.1))
            });
            // Places that no row shows are as bright as their neighbours.
            let shown: Vec<Option<f32>> = means.collect();
            let mut last = shown.iter().flatten().next().copied().unwrap_or(1.0);
            gain.extend(shown.into_iter().map(|mean| {
                last = mean.unwrap_or(last);
                1.0 / (last + DARKEST)
            }));
        }
        Self { width: template.width(), bins_per_rad, reach, gain }
    }

    /// Columns of the template.
    pub fn width(&self) -> usize {
        self.width
    }

    /// What gray values of a strand are multiplied by, place by place.
    pub fn gain(&self, phase_in_view_rad: f64) -> &[f32] {
        let row =
            ((phase_in_view_rad * self.bins_per_rad).floor() as isize).clamp(-self.reach, self.reach) + self.reach;
        &self.gain[row as usize * PLACES..(row as usize + 1) * PLACES]
    }
}

/// The line of the template, and the span in it, that show a strand at the phase of a row: rows go on from strand to strand.
fn seen<'a>(rope: &Rope, template: &'a Template, row: isize) -> Option<(&'a [f32], &'a StrandSpan)> {
    let bins = PHASE_BINS as isize;
    let from_middle = row + bins / 2;
    let strand = from_middle.div_euclid(bins).rem_euclid(rope.strands() as isize) as usize;
    let bin = from_middle.rem_euclid(bins) as usize;
    template.spans(bin).iter().find(|span| span.strand == strand).map(|span| (template.mean(bin), span))
}

/// Mean gray at a place of a strand's outline, if it is in view.
fn gray(width: usize, mean: &[f32], span: &StrandSpan, place: usize) -> Option<f32> {
    let off = 2.0 * (place as f64 + 0.5) / PLACES as f64 - 1.0;
    let column_px = span.middle_px + off * span.half_px;
    let at = column_px + (width / 2) as f64;
    let column = at.max(0.0) as usize;
    let visible = column_px >= span.from_px && column_px <= span.to_px && at >= 0.0 && column + 1 < width;
    visible.then(|| mean[column] + (at - column as f64) as f32 * (mean[column + 1] - mean[column]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::Camera;
    use crate::vision::image::GrayImage;
    use crate::vision::rope::RopeDesign;
    use crate::vision::surface::visible_spans;
    use crate::vision::template::TemplateSums;

    /// Wires that turn so many times as fast as the strands show every strand the same stripes: nothing averages out.
    const WIRE_TURNS: f64 = -2.0;

    #[test]
    fn stripes_that_every_strand_has_left_in_the_template_are_taken_out() {
        let rope = RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap();
        let camera = Camera { angle_rad: 0.0, distance_mm: 224.0, px_per_mm: 12.0 };
        let (lines, width) = (2000, 480);
        let phase = |line: usize| 0.003 * line as f64;
        let mut pixels = vec![0u8; lines * width];
        let mut spans = Vec::new();
        for (line, row) in pixels.chunks_exact_mut(width).enumerate() {
            let phases: Vec<f64> = (0..6).map(|j| phase(line) + f64::from(j) * rope.strand_step_rad()).collect();
            visible_spans(&rope, &camera, &phases, &mut spans);
            for (column, pixel) in row.iter_mut().enumerate() {
                let at = column as f64 - (width / 2) as f64;
                if let Some(span) = spans.iter().find(|span| span.from_px <= at && at < span.to_px) {
                    let wires = WIRE_TURNS * phases[span.strand];
                    *pixel = (120.0 + 30.0 * (9.0 * (span.surface_rad(at) - wires)).cos()) as u8;
                }
            }
        }
        let image = GrayImage::new(width, pixels).unwrap();
        let mut sums = TemplateSums::new(width);
        sums.add(&rope, &image, &vec![(width / 2) as f32; lines], 1, phase, |_, _, _| {});
        let template = Template::new(&rope, &camera, &sums).unwrap();
        // Ripple of the gain along the middle of the strand that faces the camera.
        let ripple = |wire_turns: Option<f64>| {
            let shade = Shade::new(&rope, &template, wire_turns, 1.2);
            let gains: Vec<f32> = (-20..=20).map(|k| shade.gain(f64::from(k) / 50.0)[PLACES / 2]).collect();
            let most = gains.iter().copied().fold(f32::MIN, f32::max);
            most / gains.iter().copied().fold(f32::MAX, f32::min) - 1.0
        };
        assert!(ripple(None) > 0.3, "{}", ripple(None));
        // A pitch is 42.7 rows of the table and 43 are averaged; the stripes wander over the strand's outline by a tenth.
        assert!(ripple(Some(WIRE_TURNS)) < 0.04, "{}", ripple(Some(WIRE_TURNS)));
    }
}
