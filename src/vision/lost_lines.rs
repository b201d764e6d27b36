//! Lines that a camera lost: all black, all saturated, or the line before once more, bit by bit.
//!
//! A line that was lost says nothing of the rope, so nothing may be read from it: it is neither measured nor learnt from nor judged.
//! No rope looks like one. Sensors make noise, so a line that was really taken never comes twice; and a rope in dim light still differs
//! from the background beside it by more than that noise, while a line without light does not.

use super::image::GrayImage;
use std::ops::Range;

/// How lines were lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Loss {
    /// As dark as the background in a dark tunnel or darker, from side to side.
    Black,
    /// At the end of the gray scale from side to side.
    Saturated,
    /// The same as the line before in every pixel.
    Repeated,
    /// The view has ended, others go on.
    Ended,
}

/// Lines that follow each other and were lost in the same way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LostRun {
    /// The lines, counted from the first of the stretch.
    pub lines: Range<usize>,
    /// How they were lost.
    pub loss: Loss,
}

/// The lines that one view lost in a stretch.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LostLines {
    runs: Vec<LostRun>,
}

impl LostLines {
    /// Adds lines after all others.
    pub(super) fn push(&mut self, lines: Range<usize>, loss: Loss) {
        match self.runs.last_mut() {
            Some(last) if last.loss == loss && last.lines.end == lines.start => last.lines.end = lines.end,
            _ if lines.is_empty() => {}
            _ => self.runs.push(LostRun { lines, loss }),
        }
    }

    /// The runs of lost lines, along the rope.
    pub fn runs(&self) -> &[LostRun] {
        &self.runs
    }

    /// Number of lost lines.
    pub fn len(&self) -> usize {
        self.runs.iter().map(|run| run.lines.len()).sum()
    }

    /// True if no line was lost.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Those of the runs that have lines in common with a range.
    pub fn within(&self, lines: Range<usize>) -> &[LostRun] {
        let from = self.runs.partition_point(|run| run.lines.end <= lines.start);
        let to = self.runs.partition_point(|run| run.lines.start < lines.end);
        &self.runs[from..to.max(from)]
    }

    /// True if a line was lost.
    pub fn contains(&self, line: usize) -> bool {
        !self.within(line..line + 1).is_empty()
    }
}

/// Finds the lost lines of one view, stretch after stretch.
#[derive(Debug, Clone, Default)]
pub struct LineWatch {
    /// The last line that was seen, and whether it was lost.
    before: Vec<u8>,
    loss: Option<Loss>,
    /// Gray of the background beside the rope, where it is dark.
    background: u8,
}

/// Gray up to which a line is as good as black whatever the background is: what sensors answer without light.
const BLACK: f32 = 12.0;
/// Gray by which a black line may be brighter than the background of lines with rope, if that is dark.
const ABOVE_BACKGROUND: f32 = 4.0;
/// Brightest background of a dark tunnel.
const DARK_TUNNEL: u8 = 40;
/// Gray from which on a pixel is saturated: lenses and converters leave a little.
const SATURATED: f32 = 250.0;
/// Gray values that the parts of a line without rope may differ by, whatever its noise: offsets of the columns.
const FLAT: f32 = 2.5;
/// The same as a multiple of the standard deviation of a part's mean.
const FLAT_SD: f32 = 5.0;
/// Parts of a line whose mean gray is compared.
const PARTS: usize = 30;
/// Of them, on either end of the order, those that do not count: columns may be broken.
const BROKEN_PARTS: usize = 2;
/// Pixels that are looked at before a line is.
const PROBES: usize = 16;
/// Every so many lines are asked for the background.
const BACKGROUND_EVERY: usize = 50;

impl LineWatch {
    /// The lines that were lost in the next stretch.
    pub fn look(&mut self, image: &GrayImage) -> LostLines {
        self.watch_background(image);
        let mut lost = LostLines::default();
        for line in 0..image.lines() {
            let row = image.line(line);
            let before = if line > 0 { image.line(line - 1) } else { &self.before };
            let loss = if row == before { Some(self.loss.unwrap_or(Loss::Repeated)) } else { self.without_rope(row) };
            if let Some(loss) = loss {
                lost.push(line..line + 1, loss);
            }
            self.loss = loss;
        }
        if let Some(last) = image.lines().checked_sub(1) {
            self.before = image.line(last).to_vec();
        }
        lost
    }

    /// Learns how dark the background is: the darkest part of most lines that show something.
    fn watch_background(&mut self, image: &GrayImage) {
        let rows = (0..image.lines()).step_by(BACKGROUND_EVERY).map(|line| image.line(line));
        let mut darkest: Vec<f32> =
            rows.filter_map(Parts::of).filter(|parts| !parts.is_flat()).map(|parts| parts.darkest).collect();
        let middle = darkest.len() / 2;
        if !darkest.is_empty() {
            self.background = *darkest.select_nth_unstable_by(middle, f32::total_cmp).1 as u8;
        }
    }

    /// Whether a line is black or saturated from side to side.
    fn without_rope(&self, row: &[u8]) -> Option<Loss> {
        let tunnel = if self.background <= DARK_TUNNEL { f32::from(self.background) + ABOVE_BACKGROUND } else { 0.0 };
        let black = BLACK.max(tunnel);
        // Hardly any line is worth a closer look.
        let probes = row.iter().step_by((row.len() / PROBES).max(1)).map(|&gray| f32::from(gray));
        let (n, dark, bright) = probes.fold((0, 0, 0), |(n, dark, bright), gray| {
            (n + 1, dark + usize::from(gray <= 2.0 * black), bright + usize::from(gray >= SATURATED))
        });
        if 8 * dark.max(bright) < 7 * n {
            return None;
        }
        let parts = Parts::of(row).filter(Parts::is_flat)?;
        if parts.brightest <= black {
            Some(Loss::Black)
        } else {
            (parts.darkest >= SATURATED).then_some(Loss::Saturated)
        }
    }
}

/// Mean gray values of the parts of a line.
struct Parts {
    /// The least and the greatest, but for a few.
    darkest: f32,
    brightest: f32,
    /// Standard deviation of one by noise.
    sd: f32,
}

impl Parts {
    /// `None` for lines that are too short to tell.
    fn of(row: &[u8]) -> Option<Self> {
        let part_px = (row.len() / PARTS).max(4);
        let mean = |part: &[u8]| part.iter().map(|&gray| u32::from(gray)).sum::<u32>() as f32 / part_px as f32;
        let mut means: Vec<f32> = row.chunks_exact(part_px).map(mean).collect();
        if means.len() <= 2 * BROKEN_PARTS {
            return None;
        }
        means.sort_unstable_by(f32::total_cmp);
        // Noise is what neighbours differ by: the median, for edges and broken columns differ by more.
        let mut steps = [0u32; 256];
        row.windows(2).for_each(|pair| steps[usize::from(pair[0].abs_diff(pair[1]))] += 1);
        let half = (row.len() - 1) as u32 / 2;
        let mut sum = 0;
        let step = steps.iter().position(|&n| {
            sum += n;
            sum > half
        })?;
        // The median of the absolute difference of two normal values is 0.95 of their sd.
        let sd = (step as f32 + 0.5) / 0.95 / (part_px as f32).sqrt();
        Some(Self { darkest: means[BROKEN_PARTS], brightest: means[means.len() - 1 - BROKEN_PARTS], sd })
    }

    /// Whether nothing but noise tells them apart.
    fn is_flat(&self) -> bool {
        self.brightest - self.darkest <= FLAT.max(FLAT_SD * self.sd)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 480;

    /// Noise that is the same whenever the same pixel is asked, of about this sd.
    fn noise(line: usize, column: usize, sd: f64) -> f64 {
        let hash = (line as u64 * 1_000_003 + column as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let uniform = |shift: u32| f64::from((hash >> shift) as u16) / 65536.0 - 0.5;
        sd * (uniform(0) + uniform(16) + uniform(32) + uniform(48)) * 3f64.sqrt()
    }

    /// Lines of a rope of wires on a background; `change` has the last word on every line.
    fn rope(
        lines: usize,
        (background, rope, sd): (f64, f64, f64),
        change: impl Fn(usize, &mut Vec<Vec<u8>>),
    ) -> GrayImage {
        let mut rows: Vec<Vec<u8>> = Vec::new();
        for line in 0..lines {
            let gray = |column: usize| {
                let wire = 1.0 + 0.5 * (0.25 * column as f64 + 0.02 * line as f64).sin();
                let at = if (60..420).contains(&column) { background + rope * wire } else { background };
                (at + noise(line, column, sd) + 0.5).clamp(0.0, 255.0) as u8
            };
            rows.push((0..WIDTH).map(gray).collect());
            change(line, &mut rows);
        }
        GrayImage::new(WIDTH, rows.concat()).unwrap()
    }

    fn lost(image: &GrayImage) -> Vec<(Range<usize>, Loss)> {
        LineWatch::default().look(image).runs().iter().map(|run| (run.lines.clone(), run.loss)).collect()
    }

    #[test]
    fn lines_that_are_black_saturated_or_repeated_are_lost_from_one_line_on() {
        let image = rope(500, (9.0, 70.0, 1.5), |line, rows| match line {
            40 => rows[line].fill(0),
            // A sensor without light, with a broken column.
            100..130 => {
                (0..WIDTH).for_each(|c| rows[line][c] = (if c == 77 { 255.0 } else { 7.0 + noise(line, c, 1.5) }) as u8)
            }
            200..203 => rows[line].fill(255),
            260 => rows[line] = rows[line - 1].clone(),
            300..400 => rows[line] = rows[299].clone(),
            400 => rows[line].fill(0),
            _ => {}
        });
        let black = |lines| (lines, Loss::Black);
        let repeated = |lines| (lines, Loss::Repeated);
        assert_eq!(
            lost(&image),
            [
                black(40..41),
                black(100..130),
                (200..203, Loss::Saturated),
                repeated(260..261),
                repeated(300..400),
                black(400..401)
            ]
        );
    }

    #[test]
    fn a_line_that_was_lost_stays_lost_when_it_comes_again_in_the_next_stretch() {
        let (mut watch, usual) = (LineWatch::default(), (9.0, 70.0, 1.5));
        let first = rope(60, usual, |_, _| {});
        let again = rope(60, usual, |line, rows| {
            if line < 5 {
                rows[line] = first.line(59).to_vec()
            }
        });
        let black = rope(60, usual, |line, rows| {
            if line < 5 {
                rows[line].fill(0)
            }
        });
        assert!(watch.look(&first).is_empty());
        assert_eq!(watch.look(&again).runs(), [LostRun { lines: 0..5, loss: Loss::Repeated }]);
        assert_eq!(watch.look(&black).runs(), [LostRun { lines: 0..5, loss: Loss::Black }]);
    }

    #[test]
    fn a_rope_in_dim_light_a_dark_line_of_it_and_a_bright_workshop_are_not_lost() {
        for light in [(1.0, 4.0, 0.7), (3.0, 6.0, 1.5), (0.0, 5.0, 0.0), (235.0, -110.0, 2.0), (250.0, -40.0, 2.0)] {
            assert_eq!(lost(&rope(300, light, |_, _| {})), [], "{light:?}");
        }
        // Light that flickers: every third line has a tenth of it.
        let flickers = rope(300, (9.0, 70.0, 1.5), |line, rows| {
            if line % 3 == 0 {
                rows[line].iter_mut().for_each(|gray| *gray /= 10);
            }
        });
        assert_eq!(lost(&flickers), []);
        // Wet and glaring over most of its width, but for the valleys.
        assert_eq!(lost(&rope(300, (9.0, 300.0, 2.0), |_, _| {})), []);
    }

    #[test]
    fn lines_within_a_range_are_found_by_their_runs() {
        let mut lost = LostLines::default();
        [(5..8, Loss::Black), (8..9, Loss::Black), (9..12, Loss::Repeated), (40..40, Loss::Ended)]
            .into_iter()
            .for_each(|(lines, loss)| lost.push(lines, loss));
        assert_eq!((lost.runs().len(), lost.len()), (2, 7));
        assert!(lost.contains(5) && lost.contains(8) && lost.contains(11) && !lost.contains(4) && !lost.contains(12));
        assert_eq!((lost.within(0..5).len(), lost.within(8..10).len(), lost.within(12..90).len()), (0, 2, 0));
    }
}
