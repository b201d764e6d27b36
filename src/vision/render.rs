//! Draws intact rope as the appearance model knows it: the generative direction. [Wacker13, sec. 4.2, fig. 10e-f]
//!
//! p(g|theta) of eq. 20 is read backwards: the geometry says which theta a pixel shows, the model which gray belongs there. A
//! person sees at a glance what was learnt, and what the model would call normal.

use super::appearance::Appearance;
use super::histogram::{CELLS, DISTANCE_BINS, GRAY_BINS, STRAND_BINS, WIRE_BINS, cell};
use super::image::GrayImage;
use super::surface_map::SurfaceMap;

/// Farthest bin, in wire phase and distance, from which the look of an unknown cell is taken; farther is left black.
const FARTHEST_BINS: f32 = 6.0;
/// Brightest gray value of a camera.
const WHITE: f32 = 255.0;

/// Which of the grays that are likely at a surface point is drawn.
pub enum Texture<'a> {
    /// Their mean: the rope without dirt, scratches and noise.
    Expected,
    /// One of them by chance, as likely as the model says. The function gives uniform numbers in [0, 1).
    Sampled(&'a mut dyn FnMut() -> f32),
}

/// Draws rope from one view's appearance.
#[derive(Debug)]
pub struct Renderer<'a> {
    appearance: &'a Appearance,
    /// Per cell: the cell whose look is drawn, itself where it is known; `None` where nothing near is known.
    sources: Vec<Option<usize>>,
}

impl<'a> Renderer<'a> {
    /// Prepares an appearance: cells that were hardly seen in training borrow the look of the nearest known one, of the same strand
    /// phase, as light changes with it most.
    pub fn new(appearance: &'a Appearance) -> Self {
        let known: Vec<bool> = (0..CELLS).map(|cell| appearance.likelihood(cell).iter().any(|&p| p > 0.0)).collect();
        let mut sources = vec![None; CELLS];
        for strand in 0..STRAND_BINS {
            for (wire, distance) in cells_of_strand() {
                sources[cell(strand, wire, distance)] = nearest_known(&known, strand, wire, distance);
            }
        }
        Self { appearance, sources }
    }

    /// Draws one line for each entry of `axis_px`, the column of the rope axis, `width_px` wide. `map` says what every pixel shows;
    /// `light` is the mean gray of the rope that [`super::appearance::GrayScale`] divides by. What is no rope is black.
    pub fn render(
        &self,
        map: &mut SurfaceMap<'_>,
        axis_px: &[f32],
        width_px: usize,
        light: f32,
        mut texture: Texture<'_>,
    ) -> GrayImage {
        let expected: Vec<f32> = match texture {
            Texture::Expected => (0..CELLS).map(|cell| self.expected_gray(cell, light)).collect(),
            Texture::Sampled(_) => Vec::new(),
        };
        let mut image = GrayImage::black(width_px, axis_px.len());
        for (line, &axis) in axis_px.iter().enumerate().filter(|(_, axis)| axis.is_finite()) {
            let row = image.line_mut(line);
            map.for_each(line, axis, |point| {
                if let (Some(source), Some(pixel)) = (self.sources[point.cell], row.get_mut(point.column)) {
                    let gray = match &mut texture {
                        Texture::Expected => expected[source],
                        Texture::Sampled(uniform) => self.sampled_gray(source, light, uniform),
                    };
                    *pixel = (gray + 0.5) as u8; // saturates
                }
            });
        }
        image
    }

    /// Mean gray of a cell; 0 if it is unknown.
    fn expected_gray(&self, cell: usize, light: f32) -> f32 {
        let likelihood = self.appearance.likelihood(cell);
        let total: f32 = likelihood.iter().sum();
        let sum: f32 = likelihood.iter().enumerate().map(|(bin, p)| p * gray(bin as f32 + 0.5, light)).sum();
        if total > 0.0 { sum / total } else { 0.0 }
    }

    /// A gray of a cell, drawn by inverting the cumulated likelihood; within a bin all grays are as likely.
    fn sampled_gray(&self, cell: usize, light: f32, uniform: &mut dyn FnMut() -> f32) -> f32 {
        let likelihood = self.appearance.likelihood(cell);
        let mut left = uniform() * likelihood.iter().sum::<f32>();
        let bin = likelihood.iter().position(|&p| {
            left -= p;
            left < 0.0
        });
        gray(bin.unwrap_or(GRAY_BINS - 1) as f32 + uniform(), light)
    }
}

/// The gray value at a place in the gray bins: the inverse of the companding g/(g + m), at the light m.
pub fn gray(bin: f32, light: f32) -> f32 {
    let share = bin / GRAY_BINS as f32;
    (light * share / (1.0 - share).max(1e-3)).min(WHITE)
}

fn cells_of_strand() -> impl Iterator<Item = (usize, usize)> {
    (0..WIRE_BINS).flat_map(|wire| (0..DISTANCE_BINS).map(move |distance| (wire, distance)))
}

/// The known cell nearest to one of the same strand phase, by bins of wire phase and distance.
fn nearest_known(known: &[bool], strand: usize, wire: usize, distance: usize) -> Option<usize> {
    if known[cell(strand, wire, distance)] {
        return Some(cell(strand, wire, distance));
    }
    cells_of_strand()
        .filter(|&(w, d)| known[cell(strand, w, d)])
        .map(|(w, d)| ((w as f32 - wire as f32).hypot(d as f32 - distance as f32), cell(strand, w, d)))
        .filter(|(bins, _)| *bins <= FARTHEST_BINS)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, cell)| cell)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::appearance::GrayScale;
    use crate::vision::bandwidths::Bandwidths;
    use crate::vision::camera::Camera;
    use crate::vision::estimates::{Estimates, StretchEstimate};
    use crate::vision::histogram::Histogram;
    use crate::vision::rope::{Rope, RopeDesign};
    use crate::vision::strand::StrandHelix;
    use crate::vision::synthesis::{Raster, gray_image, synthesise};
    use crate::vision::wire::WireHelix;

    const LINES: usize = 3000;
    const PITCH_MM: f64 = 0.2;
    const WIDTH_PX: usize = 420;
    const AXIS_PX: f32 = 209.5;
    const KNOT_LINES: usize = 20;
    const CAMERA: Camera = Camera { angle_rad: 0.5, distance_mm: 168.0, px_per_mm: 14.0 };

    fn uniform() -> impl FnMut() -> f32 {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        }
    }

    /// A rope of regular helices, darker to the sides, with noise; and what is known of its courses.
    fn drawn() -> (Rope, Estimates, GrayImage) {
        let rope = RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 24.0,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap();
        let strand = StrandHelix { lay_length_mm: 165.0, offset_rad: 0.2 };
        let wire = WireHelix { lay_length_mm: -71.0, offset_rad: 0.1 };
        let raster = Raster { lines: 0..LINES, pitch_mm: PITCH_MM, width_px: WIDTH_PX };
        let mut brightness = synthesise(&rope, &CAMERA, strand, &[wire; 6], &raster, |_| f64::from(AXIS_PX));
        for row in brightness.chunks_exact_mut(WIDTH_PX) {
            for (column, value) in row.iter_mut().enumerate() {
                *value *= 1.0 - 0.5 * ((column as f32 - AXIS_PX) / 168.0).powi(2);
            }
        }
        let mut uniform = uniform();
        let image = gray_image(&brightness, WIDTH_PX, 20.0, 150.0, || 24.0 * (uniform() - 0.5)).unwrap();
        let knots = LINES.div_ceil(KNOT_LINES);
        let middle_mm = |knot: usize| ((knot * KNOT_LINES) as f64 + (KNOT_LINES as f64 - 1.0) / 2.0) * PITCH_MM;
        let courses = |phase: &dyn Fn(usize, f64) -> f64| {
            (0..knots).flat_map(|k| (0..6).map(move |j| (j, middle_mm(k)))).map(|(j, x)| phase(j, x)).collect()
        };
        let estimates = Estimates {
            fused: StretchEstimate::default(),
            views: Vec::new(),
            knot_lines: KNOT_LINES,
            strand_phases_rad: courses(&|j, x| strand.phase_rad(&rope, j, x)),
            wire_phases_rad: courses(&|_, x| wire.phase_rad(&rope, 0, x)),
            strand_spread_rad: None,
            diameters: crate::vision::diameter::Diameters::default(),
        };
        (rope, estimates, image)
    }

    /// The appearance of an image, and its mean light.
    fn learn(map: &mut SurfaceMap<'_>, image: &GrayImage) -> (Appearance, f32) {
        let scale = GrayScale::new(image, &[AXIS_PX; LINES], 168.0);
        let mut histogram = Histogram::default();
        for line in 0..LINES {
            let (row, bins) = (image.line(line), scale.line(line));
            map.for_each(line, AXIS_PX, |p| histogram.add(p.cell, usize::from(bins[usize::from(row[p.column])])));
        }
        let body = (AXIS_PX - 0.7 * 168.0) as usize..(AXIS_PX + 0.7 * 168.0) as usize;
        let sum: f32 = (0..LINES).flat_map(|l| &image.line(l)[body.clone()]).map(|&g| f32::from(g)).sum();
        (Appearance::learn(&histogram, Bandwidths::FIXED), sum / (LINES * body.len()) as f32)
    }

    /// Correlation, and the ratio of the standard deviations, over all pixels that show known rope.
    fn compare(map: &mut SurfaceMap<'_>, original: &GrayImage, rendered: &GrayImage) -> (f64, f64) {
        let mut sums = [0.0f64; 6];
        for line in 0..LINES {
            map.for_each(line, AXIS_PX, |p| {
                let (a, b) = (f64::from(original.line(line)[p.column]), f64::from(rendered.line(line)[p.column]));
                for (sum, value) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                    *sum += value;
                }
            });
        }
        let [n, a, b, aa, bb, ab] = sums;
        let (va, vb) = (n * aa - a * a, n * bb - b * b);
        ((n * ab - a * b) / (va * vb).sqrt(), (vb / va).sqrt())
    }

    #[test]
    fn a_rope_drawn_from_its_model_looks_like_the_rope_it_was_learnt_from() {
        let (rope, estimates, image) = drawn();
        let mut map = SurfaceMap::new(&rope, &CAMERA, &estimates, WIDTH_PX);
        let (appearance, light) = learn(&mut map, &image);
        let renderer = Renderer::new(&appearance);
        let expected = renderer.render(&mut map, &[AXIS_PX; LINES], WIDTH_PX, light, Texture::Expected);
        let (correlation, contrast) = compare(&mut map, &image, &expected);
        // The windows of eq. 19 blur the wires' profile, bins cut it into steps: 0.904 when this was written.
        assert!(correlation > 0.88, "{correlation}");

        let mut uniform = uniform();
        let texture = Texture::Sampled(&mut uniform);
        let sampled = renderer.render(&mut map, &[AXIS_PX; LINES], WIDTH_PX, light, texture);
        let (correlation, sampled_contrast) = compare(&mut map, &image, &sampled);
        // Noise that was drawn and noise that was seen are independent: what they share is what was expected,
        // 0.904 * 0.76 / 1.10 = 0.62 by the contrasts of both.
        assert!(correlation > 0.58, "{correlation}");
        assert!(contrast < 0.85, "the mean is flatter than the rope: {contrast}");
        assert!((0.9..1.2).contains(&sampled_contrast), "noise is part of the look: {sampled_contrast}");
    }

    #[test]
    fn gray_and_bin_are_inverse_at_every_light() {
        for light in [20.0, 60.0, 140.0] {
            for bin in 1..24 {
                let at = bin as f32 + 0.5;
                let g = gray(at, light);
                if g < WHITE {
                    assert!((GRAY_BINS as f32 * g / (g + light) - at).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn what_is_unknown_is_borrowed_from_near_and_otherwise_black() {
        let mut known = vec![false; CELLS];
        known[cell(7, 10, 3)] = true;
        assert_eq!(nearest_known(&known, 7, 10, 3), Some(cell(7, 10, 3)));
        assert_eq!(nearest_known(&known, 7, 12, 5), Some(cell(7, 10, 3)));
        assert_eq!(nearest_known(&known, 7, 20, 3), None);
        assert_eq!(nearest_known(&known, 8, 10, 3), None); // another strand phase is lit otherwise
    }
}
