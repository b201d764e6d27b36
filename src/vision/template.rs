//! How the strands of a rope look on average from one view, wires averaged out, as a function of the strand phase.
//!
//! The contours of a rope know little of its strand phase; the valleys between strands, visible all over the image, know much
//! more. Since the view of N equal strands repeats every step 2 pi/N, the mean image over one step is learnt from the rope
//! itself, without any assumption about light: rows are bins of the phase within the step, columns are pixels about the axis.

use super::camera::Camera;
use super::image::GrayImage;
use super::rope::Rope;
use super::surface::{StrandSpan, rounded, visible_spans};
use super::wide::wide;

/// Bins of the phase within one strand step; about 1 px of strand movement each.
pub const PHASE_BINS: usize = 128;
/// Spread of the smoothing along the phase in bins: neighbouring bins share their samples.
const SMOOTHING_BINS: f32 = 1.5;

/// Which line of the template shows a phase, and which strand stands nearest then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhaseBin {
    /// Row of the template.
    pub row: usize,
    /// The strand whose phase in view is nearest to 0.
    pub nearest: usize,
}

/// Finds the bin of the phase of strand 0 in a view.
pub fn phase_bin(rope: &Rope, phase_in_view_rad: f64) -> PhaseBin {
    let steps = phase_in_view_rad / rope.strand_step_rad();
    let whole = rounded(steps);
    let row = (((steps - whole + 0.5) * PHASE_BINS as f64) as usize).min(PHASE_BINS - 1);
    PhaseBin { row, nearest: (-whole as i64).rem_euclid(rope.strands() as i64) as usize }
}

/// Reads a line of the image on the grid of the template: `axis_px` falls on the middle column, light is divided out.
/// False if the line shows nothing.
pub fn normalised_line(line: &[u8], axis_px: f32, out: &mut [f32]) -> bool {
    let width = out.len();
    let shift = axis_px - (width / 2) as f32;
    if !shift.is_finite() || shift.abs() > width as f32 {
        return false;
    }
    let whole = shift.floor();
    let fraction = shift - whole;
    let whole = whole as isize;
    let from = (-whole).max(0) as usize;
    let to = (line.len() as isize - 1 - whole).clamp(0, width as isize) as usize;
    if from >= to {
        return false;
    }
    let source = &line[(from as isize + whole) as usize..];
    // The line is as bright as its middle half is on average.
    let (low, high) = ((width / 4).clamp(from, to) - from, (3 * width / 4).clamp(from, to) - from);
    let sum = source[low..high].iter().map(|&gray| u32::from(gray)).sum::<u32>() as f32;
    let mean =
        (sum + fraction * (f32::from(source[high]) - f32::from(source[low]))) / (3 * width / 4 - width / 4) as f32;
    if mean < 1.0 {
        return false;
    }
    let (gain, gain_of_next) = ((1.0 - fraction) / mean, fraction / mean);
    out[..from].fill(0.0);
    out[to..].fill(0.0);
    wide(
        #[inline(always)]
        || {
            for ((out, &gray), &next) in out[from..to].iter_mut().zip(source).zip(&source[1..]) {
                *out = gain * f32::from(gray) + gain_of_next * f32::from(next);
            }
        },
    );
    true
}

/// Sums of normalised lines by phase, before they are divided into a template.
#[derive(Debug, Clone)]
pub struct TemplateSums {
    width: usize,
    sums: Vec<f32>,
    counts: Vec<f32>,
    line: Vec<f32>,
}

impl TemplateSums {
    /// Empty sums for images of `width` columns.
    pub fn new(width: usize) -> Self {
        Self { width, sums: vec![0.0; PHASE_BINS * width], counts: vec![0.0; PHASE_BINS], line: vec![0.0; width] }
    }

    /// Forgets a share of what was summed, so that the template follows slow changes of light and dirt.
    pub fn fade(&mut self, keep: f32) {
        self.sums.iter_mut().chain(&mut self.counts).for_each(|s| *s *= keep);
    }

    /// Adds every `stride`-th line. `phase_in_view_rad(line)` is that of strand 0; `without_wires(line, bin, gray)` takes out
    /// of the normalised line what the wires add to the mean.
    pub fn add(
        &mut self,
        rope: &Rope,
        image: &GrayImage,
        axis_px: &[f32],
        stride: usize,
        phase_in_view_rad: impl Fn(usize) -> f64,
        mut without_wires: impl FnMut(usize, PhaseBin, &mut [f32]),
    ) {
        for k in (0..image.lines()).step_by(stride) {
            if normalised_line(image.line(k), axis_px[k], &mut self.line) {
                let bin = phase_bin(rope, phase_in_view_rad(k));
                without_wires(k, bin, &mut self.line);
                let row = bin.row;
                self.counts[row] += 1.0;
                for (s, &v) in self.sums[row * self.width..(row + 1) * self.width].iter_mut().zip(&self.line) {
                    *s += v;
                }
            }
        }
    }
}

/// The learnt mean view over one strand step, with its derivatives.
#[derive(Debug, Clone)]
pub struct Template {
    width: usize,
    mean: Vec<f32>,
    per_rad: Vec<f32>,
    spans: Vec<Vec<StrandSpan>>,
}

impl Template {
    /// Divides the sums; phases that were hardly seen borrow from their neighbours. `None` if too little was summed.
    pub fn new(rope: &Rope, camera: &Camera, sums: &TemplateSums) -> Option<Self> {
        let width = sums.width;
        if sums.counts.iter().sum::<f32>() < PHASE_BINS as f32 {
            return None;
        }
        let reach = (3.0 * SMOOTHING_BINS).ceil() as isize;
        let kernel: Vec<(isize, f32)> =
            (-reach..=reach).map(|k| (k, (-0.5 * (k as f32 / SMOOTHING_BINS).powi(2)).exp())).collect();
        let mut mean = vec![0.0f32; PHASE_BINS * width];
        for row in 0..PHASE_BINS {
            let mut weight = 0.0;
            let target = &mut mean[row * width..(row + 1) * width];
            for &(k, w) in &kernel {
                // The next step shows the same picture again: rows are cyclic.
                let other = (row as isize + k).rem_euclid(PHASE_BINS as isize) as usize;
                weight += w * sums.counts[other];
                let sums = &sums.sums[other * width..(other + 1) * width];
                wide(
                    #[inline(always)]
                    || target.iter_mut().zip(sums).for_each(|(t, &s)| *t += w * s),
                );
            }
            if weight <= 0.0 {
                return None;
            }
            target.iter_mut().for_each(|t| *t /= weight);
        }
        let bin_rad = (rope.strand_step_rad() / PHASE_BINS as f64) as f32;
        let mut per_rad = vec![0.0f32; PHASE_BINS * width];
        for (row, per_rad) in per_rad.chunks_exact_mut(width).enumerate() {
            let mean = |row: usize| &mean[(row % PHASE_BINS) * width..][..width];
            for (slope, (up, down)) in per_rad.iter_mut().zip(mean(row + 1).iter().zip(mean(row + PHASE_BINS - 1))) {
                *slope = (up - down) / (2.0 * bin_rad);
            }
        }
        let spans = (0..PHASE_BINS)
            .map(|row| {
                let phase = ((row as f64 + 0.5) / PHASE_BINS as f64 - 0.5) * rope.strand_step_rad() + camera.angle_rad;
                let phases: Vec<f64> = (0..rope.strands()).map(|j| phase + j as f64 * rope.strand_step_rad()).collect();
                let mut spans = Vec::new();
                visible_spans(rope, camera, &phases, &mut spans);
                spans
            })
            .collect();
        Some(Self { width, mean, per_rad, spans })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Mean normalised gray of a row.
    pub fn mean(&self, row: usize) -> &[f32] {
        &self.mean[row * self.width..(row + 1) * self.width]
    }

    /// Change of that with the strand phase, per rad.
    pub fn per_rad(&self, row: usize) -> &[f32] {
        &self.per_rad[row * self.width..(row + 1) * self.width]
    }

    /// Visible spans in a row; strands count from the nearest one (see [`PhaseBin`]).
    pub fn spans(&self, row: usize) -> &[StrandSpan] {
        &self.spans[row]
    }

    /// Columns of the template that a span covers.
    pub fn columns(&self, span: &StrandSpan) -> (usize, usize) {
        let middle = (self.width / 2) as f64;
        let from = ((middle + span.from_px).ceil().max(0.0) as usize).min(self.width);
        (from, ((middle + span.to_px).floor().max(0.0) as usize).clamp(from, self.width))
    }

    /// Agreement of the pattern's movement with the phase in the middle of the rope, in [-1, 1]: strands on the near side move
    /// to larger columns as their phase grows, so -1 means that the hand is right and +1 that the lay has the other hand.
    pub fn slant(&self) -> f64 {
        let (mut ab, mut aa, mut bb) = (0.0f64, 0.0f64, 0.0f64);
        for row in 0..PHASE_BINS {
            let middle = self.width * 3 / 8..self.width * 5 / 8;
            let per_px = self.mean(row)[middle.start - 1..].windows(3).map(|near| (near[2] - near[0]) / 2.0);
            for (&a, b) in self.per_rad(row)[middle].iter().zip(per_px) {
                ab += f64::from(a * b);
                aa += f64::from(a * a);
                bb += f64::from(b * b);
            }
        }
        if aa * bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
    }
}
