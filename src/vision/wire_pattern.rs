//! How the wires modulate the look of the strands, learnt from the rope: the finer half of the [`Template`].
//!
//! About the mean look of a strand, wires are a periodic pattern in chi = M (psi - wire phase). Its first harmonics, as functions
//! of strand phase and column, are learnt once the wires are tracked; taken out of the image, they leave the valleys between the
//! strands to be registered without the wires' disturbance.

use super::image::GrayImage;
use super::rope::Rope;
use super::template::{PHASE_BINS, PhaseBin, Template, normalised_line, phase_bin};
use super::wide::wide;
use super::wire_tracking::strand_share;

/// Harmonics of the wire period that are kept; wires are round, so two describe them well.
pub const HARMONICS: usize = 2;
/// Spread of the smoothing along the phase in bins, after the pattern's own movement is taken out.
const SMOOTHING_BINS: f32 = 4.0;
/// Samples that a bin needs for half of its pattern to be believed.
const SHRINKAGE: f32 = 12.0;

/// Sums of what wires add to the mean look, per harmonic, row and column: complex, re and im apart.
#[derive(Debug, Clone)]
pub struct PatternSums {
    width: usize,
    re: Vec<f32>,
    im: Vec<f32>,
    counts: Vec<f32>,
    line: Vec<f32>,
}

impl PatternSums {
    /// Empty sums for images of `width` columns.
    pub fn new(width: usize) -> Self {
        let n = HARMONICS * PHASE_BINS * width;
        Self {
            width,
            re: vec![0.0; n],
            im: vec![0.0; n],
            counts: vec![0.0; PHASE_BINS * width],
            line: vec![0.0; width],
        }
    }

    /// Adds every `stride`-th line. `phases(line, strands, wires)` gives the phases of all strands and of wire 0 of each strand
    /// in rope axes, wires NaN where unknown.
    #[expect(clippy::too_many_arguments, reason = "one pass over the image with all that is known of it")]
    pub fn add(
        &mut self,
        rope: &Rope,
        template: &Template,
        angle_rad: f64,
        image: &GrayImage,
        axis_px: &[f32],
        stride: usize,
        phases: impl Fn(usize, &mut [f64], &mut [f64]),
    ) {
        let n = rope.strands();
        let (mut strands, mut wires) = (vec![0.0; n], vec![0.0; n]);
        for k in (0..image.lines()).step_by(stride) {
            if !normalised_line(image.line(k), axis_px[k], &mut self.line) {
                continue;
            }
            phases(k, &mut strands, &mut wires);
            let mean = mean_phase(rope, &strands);
            let bin = phase_bin(rope, mean - angle_rad);
            turn_with_strands(rope, angle_rad, &strands, &mut wires);
            let expected = template.mean(bin.row);
            for span in template.spans(bin.row) {
                let j = (bin.nearest + span.strand) % n;
                if wires[j].is_nan() {
                    continue;
                }
                let (from, to) = template.columns(span);
                for h in 0..HARMONICS {
                    let angle = (h + 1) as f64 * rope.wires() as f64 * (wires[j] - angle_rad);
                    let (sin, cos) = (angle.sin() as f32, angle.cos() as f32);
                    let at = (h * PHASE_BINS + bin.row) * self.width;
                    let (re, im) = (&mut self.re[at + from..at + to], &mut self.im[at + from..at + to]);
                    let differences =
                        self.line[from..to].iter().zip(&expected[from..to]).map(|(gray, mean)| gray - mean);
                    wide(
                        #[inline(always)]
                        || {
                            for ((re, im), difference) in re.iter_mut().zip(im).zip(differences) {
                                *re += difference * cos;
                                *im += difference * sin;
                            }
                        },
                    );
                }
                for count in &mut self.counts[bin.row * self.width + from..bin.row * self.width + to] {
                    *count += 1.0;
                }
            }
        }
    }
}

/// Columns between the strands.
const NO_STRAND: u32 = u32::MAX;

/// Product of complex numbers.
fn times((a, b): (f32, f32), (c, d): (f32, f32)) -> (f32, f32) {
    (a * c - b * d, a * d + b * c)
}

/// Mean phase of strand 0 over all strands.
pub fn mean_phase(rope: &Rope, strand_phases_rad: &[f64]) -> f64 {
    let n = strand_phases_rad.len() as f64;
    strand_phases_rad.iter().enumerate().map(|(j, p)| p - j as f64 * rope.strand_step_rad()).sum::<f64>() / n
}

/// Turns wires on as they seem turned in the view at `angle_rad` because their strands do not stand at their regular places.
pub fn turn_with_strands(rope: &Rope, angle_rad: f64, strands_rad: &[f64], wires_rad: &mut [f64]) {
    let mean = mean_phase(rope, strands_rad);
    for (j, (wire, strand)) in wires_rad.iter_mut().zip(strands_rad).enumerate() {
        *wire += strand_share(rope, strand - angle_rad) * (strand - j as f64 * rope.strand_step_rad() - mean);
    }
}

/// The learnt pattern: expected difference = sum over h of re_h cos(h M phase) + im_h sin(h M phase).
#[derive(Debug, Clone)]
pub struct WirePattern {
    width: usize,
    re: Vec<f32>,
    im: Vec<f32>,
}

impl WirePattern {
    /// Divides the sums, smooths along the strand phase on the strand's own surface, and shrinks what was hardly seen.
    pub fn new(rope: &Rope, template: &Template, sums: &PatternSums) -> Self {
        let width = sums.width;
        let reach = (2.5 * SMOOTHING_BINS).ceil() as isize;
        let kernel: Vec<(isize, f32)> =
            (-reach..=reach).map(|k| (k, (-0.5 * (k as f32 / SMOOTHING_BINS).powi(2)).exp())).collect();
        // Of every row and column, which strand it is on and exp(i M psi) there.
        let mut strands = vec![NO_STRAND; PHASE_BINS * width];
        let mut turns = vec![(0.0f32, 0.0f32); PHASE_BINS * width];
        for row in 0..PHASE_BINS {
            for span in template.spans(row) {
                let (from, to) = template.columns(span);
                for c in from..to {
                    let psi = span.surface_rad(c as f64 - (width / 2) as f64);
                    let (sin, cos) = (rope.wires() as f64 * psi).sin_cos();
                    turns[row * width + c] = (cos as f32, sin as f32);
                    strands[row * width + c] = span.strand as u32;
                }
            }
        }
        let mut pattern = Self { width, re: vec![0.0; sums.re.len()], im: vec![0.0; sums.im.len()] };
        let mut powers = turns.clone(); // exp(i h M psi)
        let (mut re, mut im, mut count) = (vec![0.0f32; width], vec![0.0f32; width], vec![0.0f32; width]);
        for h in 0..HARMONICS {
            if h > 0 {
                powers.iter_mut().zip(&turns).for_each(|(power, &turn)| *power = times(*power, turn));
            }
            // b = S exp(-i h M psi): the pattern seen on the surface, which hardly depends on the row.
            let of_harmonic = h * PHASE_BINS * width..(h + 1) * PHASE_BINS * width;
            let seen = sums.re[of_harmonic.clone()].iter().zip(&sums.im[of_harmonic.clone()]);
            let surface = powers.iter().zip(seen).map(|(&(c, s), (&re, &im))| times((re, im), (c, -s)));
            let (surface_re, surface_im): (Vec<f32>, Vec<f32>) = surface.unzip();
            for row in 0..PHASE_BINS {
                let here = row * width..(row + 1) * width;
                [&mut re, &mut im, &mut count].into_iter().for_each(|sums| sums.fill(0.0));
                for &(k, weight) in &kernel {
                    // Beyond the ends of the table strands change their number; the pattern there is another one's.
                    let Some(other) = row.checked_add_signed(k).filter(|&other| other < PHASE_BINS) else { continue };
                    let there = other * width..(other + 1) * width;
                    let same = strands[here.clone()].iter().zip(&strands[there.clone()]).map(|(a, b)| a == b);
                    let surface = surface_re[there.clone()].iter().zip(&surface_im[there.clone()]);
                    let there = surface.zip(&sums.counts[there]).zip(same);
                    let targets = re.iter_mut().zip(&mut im).zip(&mut count);
                    wide(
                        #[inline(always)]
                        || {
                            for (((re, im), count), (((of_re, of_im), of_count), same)) in targets.zip(there) {
                                let weight = if same { weight } else { 0.0 };
                                *re += weight * of_re;
                                *im += weight * of_im;
                                *count += weight * of_count;
                            }
                        },
                    );
                }
                for (c, at) in here.enumerate() {
                    if strands[at] != NO_STRAND {
                        let scale = 2.0 / (count[c] + SHRINKAGE);
                        let (of_re, of_im) = times((re[c], im[c]), powers[at]);
                        pattern.re[of_harmonic.start + at] = scale * of_re;
                        pattern.im[of_harmonic.start + at] = scale * of_im;
                    }
                }
            }
        }
        pattern
    }

    /// Takes the pattern of wires at `wire_phase_in_view_rad` out of the columns `from..to` of a normalised line, and writes into
    /// `per_rad` how the pattern there changes with the wire phase.
    pub fn subtract(
        &self,
        wires: usize,
        row: usize,
        wire_phase_in_view_rad: f64,
        line: &mut [f32],
        per_rad: &mut [f32],
        columns: std::ops::Range<usize>,
    ) {
        let (sin, cos) = (wires as f64 * wire_phase_in_view_rad).sin_cos();
        let turn = (cos as f32, sin as f32);
        let [(cos, sin), (cos_twice, sin_twice)] = [turn, times(turn, turn)];
        let wires = wires as f32;
        let [first, second] = std::array::from_fn::<_, HARMONICS, _>(|h| {
            let at = (h * PHASE_BINS + row) * self.width;
            self.re[at..at + self.width][columns.clone()].iter().zip(&self.im[at..at + self.width][columns.clone()])
        });
        let targets = line[columns.clone()].iter_mut().zip(&mut per_rad[columns]);
        wide(
            #[inline(always)]
            || {
                for (((value, slope), (a, b)), (a_twice, b_twice)) in targets.zip(first).zip(second) {
                    *value -= a * cos + b * sin + a_twice * cos_twice + b_twice * sin_twice;
                    *slope = wires * (b * cos - a * sin + 2.0 * (b_twice * cos_twice - a_twice * sin_twice));
                }
            },
        );
    }

    /// Takes the wires of all strands out of a normalised line: `wires_rad[j]` in rope axes, NaN where unknown. Else as in
    /// [`Self::subtract`].
    #[expect(clippy::too_many_arguments, reason = "as in `add`")]
    pub fn subtract_all(
        &self,
        rope: &Rope,
        template: &Template,
        bin: PhaseBin,
        wires_rad: &[f64],
        angle_rad: f64,
        line: &mut [f32],
        per_rad: &mut [f32],
    ) {
        for span in template.spans(bin.row) {
            let wire = wires_rad[(bin.nearest + span.strand) % wires_rad.len()];
            if !wire.is_nan() {
                let (from, to) = template.columns(span);
                self.subtract(rope.wires(), bin.row, wire - angle_rad, line, per_rad, from..to);
            }
        }
    }
}
