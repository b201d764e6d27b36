//! The image as it looks from an edge that was followed: mean gray over a few lines, by distance from the edge.
//!
//! A shadow keeps its looks from there, for its gray is a constant share of the background's; rope does not, for its wires
//! pass by.

use super::image::GrayImage;

/// How far inside the edge the strip reaches, as a share of the rope's width: shadows are hardly wider.
const DEPTH: f32 = 0.2;
/// Lines of a block, as a share of the rope's width in px: a tenth of what a wire needs to pass by.
const BLOCK: f32 = 1.0 / 48.0;
/// Pixels outside the edge that belong to the strip.
pub(super) const OUTSIDE: usize = 8;
/// Least number of blocks that tell what changes along the rope.
const LEAST_BLOCKS: usize = 12;
/// The background must be brighter than what lies inside the edge by so many gray values to show a shadow.
const LEAST_STEP: f32 = 12.0;
/// Every so many lines are looked at to see whether a column is broken, or whether the background is brighter.
const SAMPLED_LINES: usize = 32;
/// A column is broken that differs from its neighbours by so many gray values in most lines.
const BROKEN: f32 = 4.0;

/// Mean gray values along an edge.
pub(super) struct EdgeStrip {
    /// Lines of a block.
    pub block_lines: usize,
    /// Lines of the image.
    pub lines: usize,
    /// Pixels of a block: `OUTSIDE` outside the edge, the others inside.
    pub width: usize,
    /// Mean gray values, block after block, from outside to inside; NaN in blocks without an edge.
    pub gray: Vec<f32>,
    /// Noise of a single gray value by distance from the edge: sd, from how a pixel differs from that of the next line.
    pub noise: Vec<f32>,
}

/// Which blocks a strip has.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Blocks {
    /// Some, enough to judge by: cheap.
    Sampled,
    /// All, from the first line on, with the gray values of broken columns taken from their neighbours.
    All,
}

/// Blocks of a sampled strip, about.
const SAMPLED_BLOCKS: usize = 60;

impl EdgeStrip {
    /// The strip of an edge; `None` where nothing inside it is darker than the background or too few lines show it.
    /// `inward` is +1 where the rope lies at larger columns; `width_px` is the rope's width.
    pub fn of(image: &GrayImage, edges: &[f32], inward: isize, width_px: f32, which: Blocks) -> Option<Self> {
        let width = OUTSIDE + (DEPTH * width_px).round().max(8.0) as usize;
        let place = Place { columns: image.width() as isize, inward, width };
        if !darker_inside(image, edges, &place) {
            return None;
        }
        let block_lines = ((BLOCK * width_px).round() as usize).max(2);
        let blocks = edges.len() / block_lines;
        let (stride, broken) = match which {
            Blocks::Sampled => ((blocks / SAMPLED_BLOCKS).max(1), Vec::new()),
            Blocks::All => (1, broken_columns(image, edges, &place)),
        };
        let mut gray = vec![0.0f32; blocks.div_ceil(stride) * width];
        let mut noise = vec![0.0f32; width];
        let mut pairs = 0.0f32;
        let mut seen = 0;
        let (mut pixels, mut next) = (vec![0; width], vec![0; width]);
        for (gray, block) in gray.chunks_exact_mut(width).zip((0..blocks).step_by(stride)) {
            let lines = block * block_lines..(block + 1) * block_lines;
            let mut n = 0.0;
            for row in lines.clone() {
                let Some(first) = place.first(edges[row]) else { continue };
                place.take(image.line(row), first, &broken, &mut pixels);
                gray.iter_mut().zip(&pixels).for_each(|(gray, &pixel)| *gray += f32::from(pixel));
                n += 1.0;
                if row == lines.start && edges[row + 1].is_finite() {
                    place.take(image.line(row + 1), first, &broken, &mut next);
                    let differences = pixels.iter().zip(&next).map(|(pixel, next)| f32::from(pixel.abs_diff(*next)));
                    noise.iter_mut().zip(differences).for_each(|(noise, difference)| *noise += difference);
                    pairs += 1.0;
                }
            }
            if 2.0 * n < block_lines as f32 {
                gray.fill(f32::NAN);
                continue;
            }
            gray.iter_mut().for_each(|gray| *gray /= n);
            seen += 1;
        }
        // The mean absolute difference of two normal values is 2/sqrt(pi) times their sd.
        let sd = 0.5 * std::f32::consts::PI.sqrt() / pairs.max(1.0);
        noise.iter_mut().for_each(|noise| *noise *= sd);
        (seen >= LEAST_BLOCKS).then_some(Self { block_lines, lines: edges.len(), width, gray, noise })
    }

    /// Median over the blocks (of many, some) at every distance from the edge, and how far blocks are from it: sd, from the median.
    pub fn medians(values: &[f32], width: usize) -> (Vec<f32>, Vec<f32>) {
        let stride = (values.len() / width / SAMPLED_BLOCKS).max(1);
        let rows: Vec<&[f32]> = values.chunks_exact(width).step_by(stride).filter(|row| row[0].is_finite()).collect();
        let mut column = Vec::with_capacity(rows.len());
        (0..width)
            .map(|k| {
                column.clear();
                column.extend(rows.iter().map(|row| row[k]));
                let middle = column.len() / 2;
                let median = *column.select_nth_unstable_by(middle, f32::total_cmp).1;
                column.iter_mut().for_each(|value| *value = (*value - median).abs());
                (median, 1.4826 * *column.select_nth_unstable_by(middle, f32::total_cmp).1)
            })
            .unzip()
    }
}

/// Where the strip lies in a line.
struct Place {
    columns: isize,
    inward: isize,
    width: usize,
}

impl Place {
    /// Column of the strip's first pixel, the outermost, at an edge; `None` without an edge or where the image ends inside it.
    fn first(&self, edge: f32) -> Option<isize> {
        let first = edge.round() as isize - self.inward * OUTSIDE as isize;
        let last = first + self.inward * (self.width as isize - 1);
        (edge.is_finite() && (0..self.columns).contains(&last)).then_some(first)
    }

    /// Copies the strip from outside to inside; beyond the image its last column goes on.
    fn take(&self, line: &[u8], first: isize, broken: &[usize], pixels: &mut [u8]) {
        let last = first + self.inward * (self.width as isize - 1);
        if (0..self.columns).contains(&first) && self.inward > 0 {
            pixels.copy_from_slice(&line[first as usize..=last as usize]);
        } else if (0..self.columns).contains(&first) {
            pixels.copy_from_slice(&line[last as usize..=first as usize]);
            pixels.reverse();
        } else {
            for (k, pixel) in pixels.iter_mut().enumerate() {
                *pixel = line[(first + self.inward * k as isize).clamp(0, self.columns - 1) as usize];
            }
        }
        for &column in broken {
            let k = (column as isize - first) * self.inward;
            if (0..self.width as isize).contains(&k) {
                pixels[k as usize] = line[column - 1].midpoint(line[column + 1]);
            }
        }
    }
}

/// True if the background is brighter than what lies inside the edge.
fn darker_inside(image: &GrayImage, edges: &[f32], place: &Place) -> bool {
    let last = place.columns - 1;
    let (mut step, mut n) = (0.0, 0.0);
    for (row, &edge) in edges.iter().enumerate().step_by(SAMPLED_LINES) {
        let Some(first) = place.first(edge) else { continue };
        let line = image.line(row);
        let at = |k: usize| f32::from(line[(first + place.inward * k as isize).clamp(0, last) as usize]);
        let mean = |from: usize| (from..from + 4).map(at).sum::<f32>() / 4.0;
        step += mean(0) - mean(OUTSIDE + 4);
        n += 1.0;
    }
    n > 0.0 && step / n > LEAST_STEP
}

/// Columns that the strip passes whose gray is not that of their neighbours, in most lines: hot or tired ones.
fn broken_columns(image: &GrayImage, edges: &[f32], place: &Place) -> Vec<usize> {
    let firsts = edges.iter().filter_map(|&edge| place.first(edge));
    let (from, to) = firsts.fold((place.columns, 0), |(from, to), first| {
        let last = first + place.inward * (place.width as isize - 1);
        (from.min(first).min(last), to.max(first).max(last))
    });
    let (from, to) = (from.max(1) as usize, to.min(place.columns - 2) as usize);
    let rows: Vec<&[u8]> = (0..image.lines()).step_by(SAMPLED_LINES).map(|row| image.line(row)).collect();
    let mut off = Vec::with_capacity(rows.len());
    let mut median = |column: usize| {
        off.clear();
        off.extend(
            rows.iter().map(|row| 2 * i16::from(row[column]) - i16::from(row[column - 1]) - i16::from(row[column + 1])),
        );
        let middle = off.len() / 2;
        0.5 * f32::from(*off.select_nth_unstable(middle).1)
    };
    let off: Vec<f32> = (from..=to).map(&mut median).collect();
    // Both neighbours of a broken column are off by half as much the other way; those of an outline that stands still are not.
    let opposite = |k: usize, other: usize| -4.0 * off[other] * off[k].signum() > off[k].abs();
    let broken = |k: &usize| off[*k].abs() > BROKEN && opposite(*k, k - 1) && opposite(*k, k + 1);
    (1..off.len().saturating_sub(1)).filter(broken).map(|k| k + from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bright up to the edge, darker and darker inside it: 100 less 1 a pixel.
    fn image(inward: isize, edge: usize) -> GrayImage {
        let gray = |column: usize| {
            let inside = (column as isize - edge as isize) * inward;
            if inside < 0 { 200 } else { 100 - inside.min(90) as u8 }
        };
        GrayImage::new(160, (0..160 * 400).map(|p| gray(p % 160)).collect()).unwrap()
    }

    #[test]
    fn a_strip_counts_from_the_edge_inwards_on_either_side_and_beyond_the_border() {
        for (inward, edge) in [(1, 60), (1, 3), (-1, 90), (-1, 157)] {
            let image = image(inward, edge);
            let strip = EdgeStrip::of(&image, &[edge as f32; 400], inward, 100.0, Blocks::All).unwrap();
            assert_eq!(strip.width, OUTSIDE + 20);
            let row = &strip.gray[..strip.width];
            assert!(row[..OUTSIDE].iter().all(|gray| *gray == 200.0), "{inward} {edge}: {row:?}");
            assert_eq!((row[OUTSIDE], row[OUTSIDE + 19]), (100.0, 81.0));
            assert!(strip.noise.iter().all(|noise| *noise == 0.0));
        }
    }

    #[test]
    fn a_brighter_inside_an_edge_at_the_far_border_and_few_lines_make_no_strip() {
        let image = image(1, 60);
        let strip = |edge: f32, n: usize| EdgeStrip::of(&image, &vec![edge; n], 1, 100.0, Blocks::All).is_some();
        assert!(strip(60.0, 400) && !strip(60.0, 20) && !strip(150.0, 400) && !strip(f32::NAN, 400));
        let dark = GrayImage::new(160, image.pixels().iter().map(|gray| 255 - gray).collect()).unwrap();
        assert!(EdgeStrip::of(&dark, &[60.0; 400], 1, 100.0, Blocks::All).is_none());
    }

    #[test]
    fn a_hot_column_is_replaced_by_its_neighbours() {
        let mut image = image(1, 60);
        (0..400).for_each(|line| image.line_mut(line)[70] += 20);
        let strip = EdgeStrip::of(&image, &[60.0; 400], 1, 100.0, Blocks::All).unwrap();
        assert!((strip.gray[OUTSIDE + 10] - 90.0).abs() <= 1.0, "{}", strip.gray[OUTSIDE + 10]);
    }

    #[test]
    fn medians_say_what_blocks_are_like_and_how_unlike_they_are() {
        let values: Vec<f32> = (0..101).flat_map(|block| [5.0, block as f32]).chain([f32::NAN; 2]).collect();
        let (median, spread) = EdgeStrip::medians(&values, 2);
        assert_eq!((median[0], spread[0]), (5.0, 0.0));
        assert!((median[1] - 50.0).abs() <= 1.0 && (spread[1] - 37.0).abs() < 2.0, "{median:?} {spread:?}");
    }
}
