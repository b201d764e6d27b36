//! One edge of the rope, followed from line to line to a fraction of a pixel.
//!
//! The background is followed beside the edge, so that dark camera tunnels and bright workshops both serve; the edge is where
//! the difference crosses half of what it reaches just inside the rope. It is followed in a window, which is fast and does not
//! jump to scratches or loose wires.

use super::edge_search::{BODY_SHARE, LEAST_CONTRAST, SEARCH_EVERY, SIGNIFICANT_SD};

/// Half width of the window in which an edge is followed, in px. Strand outlines move by less than 1 px a line, wire ends jump.
const WINDOW_PX: usize = 14;
/// Pixels inside the edge over which the rope's own brightness is taken.
const INSIDE_PX: usize = 8;
/// Pixels outside the window over which the background is taken.
const BACKGROUND_PX: usize = 10;
/// Pixels outside the middle of the window that are looked at, and all.
const OUTSIDE_PX: usize = BACKGROUND_PX + WINDOW_PX;
const SEEN_PX: usize = OUTSIDE_PX + WINDOW_PX + INSIDE_PX;
/// Lines over which the background is averaged, as a recursive filter.
const BACKGROUND_LINES: f32 = 24.0;

/// One edge while it is followed.
pub(super) struct EdgeTracker {
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
    pub(super) fn new(inward: isize) -> Self {
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
    pub(super) fn follow(&mut self, line: &[u8], coarse: impl FnOnce() -> Option<(f32, f32)>) -> f32 {
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

    /// True where `follow` wants the edge that a search of the whole line finds.
    pub(super) fn is_due(&self) -> bool {
        !self.locked && self.missed + 1 >= SEARCH_EVERY
    }

    /// Forgets the edge; the next line is searched.
    pub(super) fn let_go(&mut self) {
        (self.locked, self.missed) = (false, SEARCH_EVERY);
    }

    /// Lets go of an edge that a search of the whole line sees elsewhere.
    pub(super) fn check(&mut self, edge_px: f32, body: f32) {
        self.body = body;
        if self.locked && (edge_px - self.edge_px).abs() > WINDOW_PX as f32 {
            self.let_go();
        }
    }

    fn refine(&mut self, line: &[u8]) -> Option<f32> {
        let width = line.len() as isize;
        let centre = self.edge_px.round() as isize;
        // Gray values of the window and its surroundings from outside to inside; NaN beyond the image, which compares false.
        let mut gray = [f32::NAN; SEEN_PX];
        let first = centre - if self.inward > 0 { OUTSIDE_PX } else { SEEN_PX - 1 - OUTSIDE_PX } as isize;
        let seen = first.clamp(0, width)..(first + SEEN_PX as isize).clamp(0, width);
        let known = gray.iter_mut().skip((seen.start - first) as usize);
        known.zip(&line[seen.start as usize..seen.end as usize]).for_each(|(gray, &seen)| *gray = f32::from(seen));
        if self.inward < 0 {
            gray.reverse();
        }
        let moments = |gray: &[f32]| {
            let known = gray.iter().filter(|gray| gray.is_finite());
            known.fold((0.0, 0.0, 0.0), |(n, sum, squares), gray| (n + 1.0, sum + gray, squares + gray * gray))
        };
        let (mut n, mut sum, mut squares) = moments(&gray[..BACKGROUND_PX]);
        if n < 3.0 {
            // The window touches the border: what little lies outside the edge is the background.
            (n, sum, squares) = moments(&gray[..OUTSIDE_PX - 2]);
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
        let difference = gray.map(|gray| (gray - self.background).abs());
        // First significant pixel from outside whose neighbourhood inside is significant too: not a speck.
        let is_speck = |k: usize| difference[k + 1..k + 5].iter().filter(|d| **d > least).count() < 3;
        let first = (BACKGROUND_PX..=OUTSIDE_PX + WINDOW_PX).find(|&k| difference[k] > least && !is_speck(k))?;
        let inside = difference[first..first + INSIDE_PX].iter().copied().fold(0.0, f32::max);
        let level = (inside / 2.0).max(least * 0.75);
        let crossing = (first - 2..first + INSIDE_PX).find(|&k| difference[k] >= level)?;
        let (outer, inner) = (difference[crossing - 1], difference[crossing]);
        let fraction = if inner > outer { ((level - outer) / (inner - outer)).clamp(0.0, 1.0) } else { 1.0 };
        let inwards = crossing as f32 - 1.0 + fraction - OUTSIDE_PX as f32;
        (!outer.is_nan()).then_some(centre as f32 + self.inward as f32 * inwards)
    }
}
