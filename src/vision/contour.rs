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

/// Both edges of the widest thing in a line that differs from the line's own margins.
///
/// Answers lower edge, upper edge and how far the body of the rope differs from the background.
fn coarse_edges(image: &GrayImage, line: usize, hint_px: Option<f64>) -> Option<(f32, f32, f32)> {
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
    // The body: what the middle half of the image differs from both margins, typically.
    let mut differences: Vec<f32> =
        (width / 4..3 * width / 4).map(|c| (mean[c] - (left + right) / 2.0).abs()).collect();
    let middle = differences.len() / 2;
    let body = *differences.select_nth_unstable_by(middle, f32::total_cmp).1;
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
    for row in 0..image.lines() {
        let line = image.line(row);
        if row > 0
            && row % CHECK_EVERY == 0
            && let Some((l, u, body)) = coarse_edges(image, row, hint_px)
        {
            lower.check(l, body);
            upper.check(u, body);
        }
        if (!lower.locked && lower.missed + 1 >= SEARCH_EVERY) || (!upper.locked && upper.missed + 1 >= SEARCH_EVERY) {
            // Lost one edge: look for both again, for they lend each other plausibility.
            (lower.locked, upper.locked) = (false, false);
            (lower.missed, upper.missed) = (SEARCH_EVERY, SEARCH_EVERY);
            let edges = coarse_edges(image, row, hint_px);
            contours.lower_px.push(lower.follow(line, || edges.map(|e| (e.0, e.2))));
            contours.upper_px.push(upper.follow(line, || edges.map(|e| (e.1, e.2))));
        } else {
            contours.lower_px.push(lower.follow(line, || None));
            contours.upper_px.push(upper.follow(line, || None));
        }
    }
    if let Some(hint_px) = hint_px {
        for (l, u) in contours.lower_px.iter_mut().zip(&mut contours.upper_px) {
            if f64::from(*u - *l) < 0.6 * hint_px {
                (*l, *u) = (f32::NAN, f32::NAN);
            }
        }
    }
    contours
}
