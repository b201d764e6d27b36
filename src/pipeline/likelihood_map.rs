//! The likelihood map of a stretch, as people look at it: dark is unlikely.
//!
//! A model has one gray scale, whatever threshold an inspection decides by: usual rope is light, and black is a place as unlikely as what
//! raises an alarm by the model's own threshold. So what is black in a map is worth a look in every inspection with that model, and
//! gray says how near to it the rest comes. How far beyond, the scores say.

use crate::vision::evidence::blocks;
use crate::vision::inspection_model::AlignedView;
use crate::vision::stretch_scores::StretchScores;

/// Gray and alpha of what was not judged or is no rope. No place that was judged has its gray, so that readers without alpha can tell.
const NOT_JUDGED: [u8; 2] = [255, 0];
/// Gray of usual rope, whose score is 0 or less.
const USUAL: f32 = 254.0;

/// Gray and alpha, line after line.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct LikelihoodMap {
    /// Gray, and alpha: 255 where it was judged, else 0.
    pub pixels: Vec<[u8; 2]>,
}

impl LikelihoodMap {
    /// Nothing was judged.
    pub fn not_judged(width_px: usize, lines: usize) -> Self {
        Self { pixels: vec![NOT_JUDGED; width_px * lines] }
    }

    /// Draws the scores of a view; `alarm_score` is the model's threshold.
    pub fn of(seen: &AlignedView<'_>, scores: &StretchScores, alarm_score: f64) -> Self {
        let (lines, width_px) = (seen.view.image.lines(), seen.view.image.width());
        let mut drawn = Self { pixels: Vec::with_capacity(width_px * lines) };
        let mut map = seen.surface_map();
        let mut row = vec![NOT_JUDGED; width_px];
        for (block, (of_block, middle)) in blocks(lines, scores.block_lines).enumerate() {
            let first = block * seen.rope.strands() * scores.places;
            row.fill(NOT_JUDGED);
            map.for_each(middle, seen.view.axis_px[middle], |point| {
                let score = scores.cells[first + point.strand * scores.places + point.place];
                if score.is_finite() {
                    row[point.column] = [gray(score, alarm_score as f32), 255];
                }
            });
            // A score holds for a block.
            of_block.for_each(|_| drawn.pixels.extend_from_slice(&row));
        }
        drawn
    }
}

fn gray(score: f32, alarm_score: f32) -> u8 {
    (USUAL * (1.0 - score / alarm_score).clamp(0.0, 1.0)).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_is_what_raises_an_alarm_and_usual_rope_is_light_but_never_as_light_as_what_was_not_judged() {
        assert_eq!([-3.0, 0.0, 8.0, 16.0, 40.0].map(|score| gray(score, 16.0)), [254, 254, 127, 0, 0]);
        assert!((-40..400).all(|tenth| gray(tenth as f32 / 10.0, 7.3) != NOT_JUDGED[0]));
    }
}
