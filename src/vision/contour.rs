//! Upper and lower edge of the rope in every camera line, to a fraction of a pixel. [Wacker13, sec. 3.3.1: rc^u, rc^l]
//!
//! The paper leaves the extraction open. Here the rope is what differs from the background: the background is followed beside
//! each edge, so that dark camera tunnels and bright workshops both serve; the edge is where the difference crosses half of
//! what it reaches just inside the rope. Edges are followed from line to line in a window, which is fast and does not jump to
//! scratches or loose wires; a lost edge is searched again over the whole line. Where what was followed is the outline of a
//! shadow on the background, the rope's own edge is found inside it.

use super::edge_search::{SEARCH_EVERY, body_contrast, coarse_edges};
use super::edge_strip::{Blocks, EdgeStrip};
use super::edge_tracker::EdgeTracker;
use super::image::GrayImage;
use super::lost_lines::LostLines;
use super::shadow::is_shadow;
use super::shadowed_edge::rope_inside;

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

/// Lines between two checks of the edges that are followed against a search of the whole line.
const CHECK_EVERY: usize = 200;
/// Half width of the running median over the extracted edges, in lines: single lines flicker where an edge is hardly lit.
const MEDIAN_LINES: usize = 4;

fn median_filtered(edges: &[f32]) -> Vec<f32> {
    // The known edges near a line, sorted: from line to line one comes in and one goes.
    let mut near: Vec<f32> = Vec::with_capacity(2 * MEDIAN_LINES + 2);
    let place = |near: &[f32], edge: f32| near.iter().filter(|&&other| other < edge).count();
    let known = |line: usize| edges.get(line).copied().filter(|edge| edge.is_finite());
    let mut filtered = Vec::with_capacity(edges.len());
    for coming in 0..edges.len() + MEDIAN_LINES {
        if let Some(edge) = known(coming) {
            near.insert(place(&near, edge), edge);
        }
        if let Some(edge) = coming.checked_sub(2 * MEDIAN_LINES + 1).and_then(known) {
            near.remove(place(&near, edge));
        }
        if let Some(line) = coming.checked_sub(MEDIAN_LINES) {
            filtered.push(known(line).map_or(f32::NAN, |_| near[near.len() / 2]));
        }
    }
    filtered
}

/// Moves edges that are those of shadows to where the rope begins.
fn step_out_of_shadows(image: &GrayImage, contours: &mut Contours) {
    let Some(width_px) = middle_width(contours) else { return };
    for (edges, inward) in [(&mut contours.lower_px, 1), (&mut contours.upper_px, -1)] {
        let strip = |blocks| EdgeStrip::of(image, edges, inward, width_px, blocks);
        if strip(Blocks::Sampled).is_some_and(|sample| is_shadow(&sample))
            && let Some(depth_px) = strip(Blocks::All).and_then(|strip| rope_inside(&strip))
        {
            for (edge, depth_px) in edges.iter_mut().zip(depth_px) {
                *edge += inward as f32 * depth_px;
            }
        }
    }
}

/// Median distance between both edges, from some of the lines; `None` if hardly any shows both.
fn middle_width(contours: &Contours) -> Option<f32> {
    let both = contours.lower_px.iter().zip(&contours.upper_px).step_by(SEARCH_EVERY);
    let mut widths: Vec<f32> = both.map(|(lower, upper)| upper - lower).filter(|width| width.is_finite()).collect();
    let middle = widths.len() / 2;
    (widths.len() >= 3).then(|| *widths.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Extracts both edges of every line but those that were lost. `hint_px`: expected rope width in px, if known; what is much narrower is
/// no rope.
pub fn extract(image: &GrayImage, lost: &LostLines, hint_px: Option<f64>) -> Contours {
    let mut lower = EdgeTracker::new(1);
    let mut upper = EdgeTracker::new(-1);
    let mut contours = Contours::default();
    if image.width() < 32 || image.lines() == 0 {
        return contours;
    }
    let body = body_contrast(image, lost);
    for row in 0..image.lines() {
        if let Some(run) = lost.within(row..row + 1).first() {
            contours.lower_px.push(f32::NAN);
            contours.upper_px.push(f32::NAN);
            if row + 1 == run.lines.end && run.lines.len() >= SEARCH_EVERY {
                // The rope may have moved meanwhile.
                lower.let_go();
                upper.let_go();
            }
            continue;
        }
        let line = image.line(row);
        if row > 0
            && row % CHECK_EVERY == 0
            && let Some((l, u, body)) = coarse_edges(image, lost, row, body, hint_px)
        {
            lower.check(l, body);
            upper.check(u, body);
        }
        if lower.is_due() || upper.is_due() {
            // Lost one edge: look for both again, for they lend each other plausibility.
            lower.let_go();
            upper.let_go();
            let edges = coarse_edges(image, lost, row, body, hint_px);
            contours.lower_px.push(lower.follow(line, || edges.map(|e| (e.0, e.2))));
            contours.upper_px.push(upper.follow(line, || edges.map(|e| (e.1, e.2))));
        } else {
            contours.lower_px.push(lower.follow(line, || None));
            contours.upper_px.push(upper.follow(line, || None));
        }
    }
    contours.lower_px = median_filtered(&contours.lower_px);
    contours.upper_px = median_filtered(&contours.upper_px);
    step_out_of_shadows(image, &mut contours);
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
            let contours = extract(&band(600, edges, background, |_| rope), &LostLines::default(), None);
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
        let contours = extract(&GrayImage::new(200, pixels).unwrap(), &LostLines::default(), None);
        assert!(contours.upper_px[50..].iter().all(|u| (u - 150.0).abs() < 2.0));
    }

    #[test]
    fn constant_gray_and_noise_show_no_rope() {
        let flat = GrayImage::new(200, vec![90; 200 * 300]).unwrap();
        assert_eq!(extract(&flat, &LostLines::default(), Some(150.0)).found(), 0.0);
        let noise = (0..200 * 300).map(|k: u32| (k.wrapping_mul(2_654_435_761) >> 27) as u8).collect();
        assert!(extract(&GrayImage::new(200, noise).unwrap(), &LostLines::default(), Some(150.0)).found() < 0.05);
    }
}
