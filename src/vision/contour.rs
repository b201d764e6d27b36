//! Upper and lower edge of the rope in every camera line, to a fraction of a pixel. [Wacker13, sec. 3.3.1: rc^u, rc^l]
//!
//! The paper leaves the extraction open. Here the rope is what differs from the background: the background is followed beside
//! each edge, so that dark camera tunnels, bright workshops and shadows all serve; the edge is where the difference crosses
//! half of what it reaches just inside the rope. Edges are followed from line to line in a window, which is fast and does
//! not jump to scratches or loose wires; a lost edge is searched again over the whole line.

use super::image::GrayImage;

/// Edges of the rope, one entry a line; NaN where a line shows none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Contours {
    /// Column of the lower edge (the smaller column).
    pub lower_px: Vec<f32>,
    /// Column of the upper edge.
    pub upper_px: Vec<f32>,
}

impl Contours {
    /// Number of lines.
    pub fn len(&self) -> usize {
        self.lower_px.len()
    }

    /// True without lines.
    pub fn is_empty(&self) -> bool {
        self.lower_px.is_empty()
    }

    /// Those of a range of lines, cut to the lines that there are.
    pub fn of(&self, lines: std::ops::Range<usize>) -> Self {
        let lines = lines.start.min(self.len())..lines.end.min(self.len());
        Self { lower_px: self.lower_px[lines.clone()].to_vec(), upper_px: self.upper_px[lines].to_vec() }
    }

    /// Contours one after the other.
    pub fn joined(parts: [&Self; 3]) -> Self {
        Self {
            lower_px: parts.map(|part| &part.lower_px[..]).concat(),
            upper_px: parts.map(|part| &part.upper_px[..]).concat(),
        }
    }

    /// Share of lines that show both edges.
    pub fn found(&self) -> f64 {
        let both = self.lower_px.iter().zip(&self.upper_px).filter(|(l, u)| l.is_finite() && u.is_finite()).count();
        both as f64 / self.len().max(1) as f64
    }
}

/// Half width of the window in which an edge is followed, in px. Strand outlines move by less than 1 px a line, wire ends jump.
const WINDOW_PX: isize = 14;
/// Pixels inside the edge over which the rope's own brightness is taken.
const INSIDE_PX: isize = 8;
/// Pixels outside the window over which the background is taken.
const BACKGROUND_PX: isize = 10;
/// Lines over which the background is averaged, as a recursive filter.
const BACKGROUND_LINES: f32 = 24.0;
/// The edge must differ from the background by this many standard deviations of the background.
const SIGNIFICANT_SD: f32 = 4.0;
/// The edge must differ from the background by this share of what the rope's body does: stray light beside the rope does not.
const BODY_SHARE: f32 = 0.25;
/// Least difference in gray values that is taken for a rope, whatever the noise.
const LEAST_CONTRAST: f32 = 5.0;
/// Lines between two checks of the edges that are followed against a search of the whole line.
const CHECK_EVERY: usize = 200;
/// Lines between two searches for a lost edge.
const SEARCH_EVERY: usize = 16;

/// One edge while it is followed.
struct EdgeTracker {
    /// +1: the rope lies at larger columns (lower edge); -1: at smaller ones.
    inward: isize,
    edge_px: f32,
    background: f32,
    variance: f32,
    /// How far the rope's body differs from the background, in gray values.
    body: f32,
    locked: bool,
    missed: usize,
}

impl EdgeTracker {
    fn new(inward: isize) -> Self {
        Self {
            inward,
            edge_px: f32::NAN,
            background: f32::NAN,
            variance: 0.0,
            body: 0.0,
            locked: false,
            missed: SEARCH_EVERY,
        }
    }

    /// The edge in a line, or NaN. `coarse` searches the whole line: the edge and the contrast of the rope's body.
    fn follow(&mut self, line: &[u8], coarse: impl FnOnce() -> Option<(f32, f32)>) -> f32 {
        if !self.locked {
            self.missed += 1;
            if self.missed < SEARCH_EVERY {
                return f32::NAN;
            }
            self.missed = 0;
            let Some((edge_px, body)) = coarse() else { return f32::NAN };
            self.edge_px = edge_px;
            self.body = body;
            self.background = f32::NAN;
        }
        let found = self.refine(line);
        match found {
            Some(edge_px) => {
                self.locked = true;
                self.missed = 0;
                // Follow slowly: one line with a wire end sticking out must not drag the window away.
                self.edge_px += (edge_px - self.edge_px).clamp(-1.5, 1.5);
                edge_px
            }
            None => {
                self.missed += 1;
                self.locked = self.locked && self.missed < SEARCH_EVERY;
                f32::NAN
            }
        }
    }

    /// Lets go of an edge that a search of the whole line sees elsewhere.
    fn check(&mut self, edge_px: f32, body: f32) {
        self.body = body;
        if self.locked && (edge_px - self.edge_px).abs() > WINDOW_PX as f32 {
            (self.locked, self.missed) = (false, SEARCH_EVERY);
        }
    }

    fn refine(&mut self, line: &[u8]) -> Option<f32> {
        let width = line.len() as isize;
        let centre = self.edge_px.round() as isize;
        // `at(k)`: the gray value k px inside the centre of the window.
        let at = |k: isize| {
            let column = centre + k * self.inward;
            (0..width).contains(&column).then(|| f32::from(line[column as usize]))
        };
        let mut sum = 0.0;
        let mut squares = 0.0;
        let mut n = 0.0;
        for k in -(WINDOW_PX + BACKGROUND_PX)..-WINDOW_PX {
            if let Some(gray) = at(k) {
                sum += gray;
                squares += gray * gray;
                n += 1.0;
            }
        }
        if n < 3.0 {
            // The window touches the border: what little lies outside the edge is the background.
            for k in -WINDOW_PX..-2 {
                if let Some(gray) = at(k) {
                    sum += gray;
                    squares += gray * gray;
                    n += 1.0;
                }
            }
        }
        if n < 2.0 {
            return None; // the rope runs out of the image
        }
        let mean = sum / n;
        let variance = (squares / n - mean * mean).max(0.25);
        if self.background.is_nan() {
            (self.background, self.variance) = (mean, variance);
        } else {
            self.background += (mean - self.background) / BACKGROUND_LINES;
            self.variance += (variance - self.variance) / BACKGROUND_LINES;
        }
        let least = (SIGNIFICANT_SD * self.variance.sqrt()).max(LEAST_CONTRAST).max(BODY_SHARE * self.body);
        let difference = |k: isize| at(k).map(|gray| (gray - self.background).abs());
        // First significant pixel from outside whose neighbourhood inside is significant too: not a speck.
        let first = (-WINDOW_PX..=WINDOW_PX).find(|&k| {
            difference(k).is_some_and(|d| d > least)
                && (1..=4).filter(|&m| difference(k + m).is_some_and(|d| d > least)).count() >= 3
        })?;
        let inside = (0..INSIDE_PX).filter_map(|m| difference(first + m)).fold(0.0, f32::max);
        let level = (inside / 2.0).max(least * 0.75);
        let crossing = (first - 2..first + INSIDE_PX).find(|&k| difference(k).is_some_and(|d| d >= level))?;
        let (outer, inner) = (difference(crossing - 1)?, difference(crossing)?);
        let fraction = if inner > outer { ((level - outer) / (inner - outer)).clamp(0.0, 1.0) } else { 1.0 };
        Some(centre as f32 + self.inward as f32 * ((crossing - 1) as f32 + fraction))
    }
}

/// How far the body of the rope differs from both margins: the median over the middle half of the columns, all lines averaged.
fn body_contrast(image: &GrayImage) -> f32 {
    let width = image.width();
    let mut mean = vec![0.0f32; width];
    let rows: Vec<usize> = (0..image.lines()).step_by(SEARCH_EVERY).collect();
    for &row in &rows {
        for (m, &gray) in mean.iter_mut().zip(image.line(row)) {
            *m += f32::from(gray) / rows.len() as f32;
        }
    }
    let margin = (width / 40).max(4);
    let margins = mean[..margin].iter().chain(&mean[width - margin..]).sum::<f32>() / (2 * margin) as f32;
    let mut differences: Vec<f32> = mean[width / 4..3 * width / 4].iter().map(|m| (m - margins).abs()).collect();
    let middle = differences.len() / 2;
    *differences.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Half width of the running median over the extracted edges, in lines: single lines flicker where an edge is hardly lit.
const MEDIAN_LINES: usize = 4;

fn median_filtered(edges: &[f32]) -> Vec<f32> {
    let mut window = Vec::with_capacity(2 * MEDIAN_LINES + 1);
    (0..edges.len())
        .map(|k| {
            if edges[k].is_nan() {
                return f32::NAN;
            }
            window.clear();
            let near = &edges[k.saturating_sub(MEDIAN_LINES)..(k + MEDIAN_LINES + 1).min(edges.len())];
            window.extend(near.iter().copied().filter(|e| e.is_finite()));
            let middle = window.len() / 2;
            *window.select_nth_unstable_by(middle, f32::total_cmp).1
        })
        .collect()
}

/// Both edges of the widest thing in a line that differs from the line's own margins.
///
/// Answers lower edge, upper edge and how far the body of the rope differs from the background.
fn coarse_edges(image: &GrayImage, line: usize, body: f32, hint_px: Option<f64>) -> Option<(f32, f32, f32)> {
    let width = image.width();
    let from = line.saturating_sub(SEARCH_EVERY / 2);
    let to = (from + SEARCH_EVERY).min(image.lines());
    let n = (to - from) as f32;
    let mut mean = vec![0.0f32; width];
    let mut squares = vec![0.0f32; width];
    for row in from..to {
        for (column, &gray) in image.line(row).iter().enumerate() {
            let gray = f32::from(gray);
            mean[column] += gray;
            squares[column] += gray * gray;
        }
    }
    for (m, s) in mean.iter_mut().zip(&mut squares) {
        *m /= n;
        *s = (*s / n - *m * *m).max(0.0);
    }
    let margin = (width / 40).max(4);
    let side = |range: std::ops::Range<usize>| {
        let m = range.clone().map(|c| mean[c]).sum::<f32>() / range.len() as f32;
        let v = range.clone().map(|c| squares[c] + (mean[c] - m).powi(2)).sum::<f32>() / range.len() as f32;
        (m, v)
    };
    let (left, left_variance) = side(0..margin);
    let (right, right_variance) = side(width - margin..width);
    let step = |inward: isize| {
        // Walk inward with a background that follows slow gradients but not an edge.
        let (mut background, mut variance) = if inward > 0 { (left, left_variance) } else { (right, right_variance) };
        let columns: Vec<usize> = if inward > 0 { (0..width).collect() } else { (0..width).rev().collect() };
        let differs = |c: usize, background: f32, variance: f32| {
            let least = (SIGNIFICANT_SD * variance.sqrt() * 0.5).max(LEAST_CONTRAST).max(BODY_SHARE * body);
            (mean[c] - background).abs() > least
        };
        for (k, &column) in columns.iter().enumerate() {
            if differs(column, background, variance) {
                let ahead = &columns[k..(k + 8).min(columns.len())];
                if ahead.len() == 8 && ahead.iter().filter(|&&c| differs(c, background, variance)).count() >= 6 {
                    return Some(column as f32);
                }
            } else {
                background += (mean[column] - background) / 12.0;
                variance += (squares[column] - variance) / 12.0;
            }
        }
        None
    };
    let (lower, upper) = (step(1)?, step(-1)?);
    let least_width = hint_px.map_or(width as f64 / 8.0, |hint| 0.7 * hint);
    (f64::from(upper - lower) >= least_width).then_some((lower, upper, body))
}

/// Extracts both edges of every line. `hint_px`: expected rope width in px, if known; what is much narrower is no rope.
pub fn extract(image: &GrayImage, hint_px: Option<f64>) -> Contours {
    let mut lower = EdgeTracker::new(1);
    let mut upper = EdgeTracker::new(-1);
    let mut contours = Contours::default();
    if image.width() < 32 || image.lines() == 0 {
        return contours;
    }
    let body = body_contrast(image);
    for row in 0..image.lines() {
        let line = image.line(row);
        if row > 0
            && row % CHECK_EVERY == 0
            && let Some((l, u, body)) = coarse_edges(image, row, body, hint_px)
        {
            lower.check(l, body);
            upper.check(u, body);
        }
        if (!lower.locked && lower.missed + 1 >= SEARCH_EVERY) || (!upper.locked && upper.missed + 1 >= SEARCH_EVERY) {
            // Lost one edge: look for both again, for they lend each other plausibility.
            (lower.locked, upper.locked) = (false, false);
            (lower.missed, upper.missed) = (SEARCH_EVERY, SEARCH_EVERY);
            let edges = coarse_edges(image, row, body, hint_px);
            contours.lower_px.push(lower.follow(line, || edges.map(|e| (e.0, e.2))));
            contours.upper_px.push(upper.follow(line, || edges.map(|e| (e.1, e.2))));
        } else {
            contours.lower_px.push(lower.follow(line, || None));
            contours.upper_px.push(upper.follow(line, || None));
        }
    }
    contours.lower_px = median_filtered(&contours.lower_px);
    contours.upper_px = median_filtered(&contours.upper_px);
    if let Some(hint_px) = hint_px {
        for (l, u) in contours.lower_px.iter_mut().zip(&mut contours.upper_px) {
            if f64::from(*u - *l) < 0.6 * hint_px {
                (*l, *u) = (f32::NAN, f32::NAN);
            }
        }
    }
    contours
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bright or dark band between `lower` and `upper` (sub-pixel) on a background, edges blurred over a pixel.
    fn band(
        lines: usize,
        edges: impl Fn(usize) -> (f64, f64),
        background: u8,
        rope: impl Fn(usize) -> u8,
    ) -> GrayImage {
        let mut pixels = Vec::new();
        for k in 0..lines {
            let (lower, upper) = edges(k);
            for c in 0..200 {
                let inside =
                    ((c as f64 - lower + 0.5).clamp(0.0, 1.0) * (upper - c as f64 + 0.5).clamp(0.0, 1.0)).max(0.0);
                let gray = f64::from(background) + inside * (f64::from(rope(c)) - f64::from(background));
                pixels.push((gray + ((k * 31 + c * 17) % 3) as f64) as u8);
            }
        }
        GrayImage::new(200, pixels).unwrap()
    }

    #[test]
    fn follows_edges_to_a_fraction_of_a_pixel_on_dark_and_bright_backgrounds() {
        let edges = |k: usize| (30.0 + 5.0 * (k as f64 / 60.0).sin(), 160.0 + 4.0 * (k as f64 / 45.0).cos());
        for (background, rope) in [(8u8, 120u8), (210, 90)] {
            let contours = extract(&band(600, edges, background, |_| rope), None);
            let error = |found: &[f32], truth: &dyn Fn(usize) -> f64| {
                (20..600).map(|k| (f64::from(found[k]) - truth(k)).abs()).fold(0.0, f64::max)
            };
            assert!(contours.found() > 0.98);
            assert!(error(&contours.lower_px, &|k| edges(k).0) < 0.8);
            assert!(error(&contours.upper_px, &|k| edges(k).1) < 0.8);
        }
    }

    #[test]
    fn a_shelf_of_stray_light_beside_the_rope_is_not_its_edge() {
        let image = band(400, |_| (40.0, 150.0), 8, |_| 100);
        let mut pixels = image.pixels().to_vec();
        for row in pixels.chunks_exact_mut(200) {
            row[151..175].iter_mut().for_each(|g| *g = (*g).max(18));
        }
        let contours = extract(&GrayImage::new(200, pixels).unwrap(), None);
        assert!(contours.upper_px[50..].iter().all(|u| (u - 150.0).abs() < 2.0));
    }

    #[test]
    fn constant_gray_and_noise_show_no_rope() {
        let flat = GrayImage::new(200, vec![90; 200 * 300]).unwrap();
        assert_eq!(extract(&flat, Some(150.0)).found(), 0.0);
        let noise = (0..200 * 300).map(|k: u32| (k.wrapping_mul(2_654_435_761) >> 27) as u8).collect();
        assert!(extract(&GrayImage::new(200, noise).unwrap(), Some(150.0)).found() < 0.05);
    }
}
