//! What an expert would mark: per view the lines and columns in which a defect can be seen.

use super::defects;
use super::photographic::LinePainter;
use super::recipe::Kind;
use super::scene::Scene;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// One run of lines of one view in which a defect shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Label {
    /// Number of the defect.
    pub defect: usize,
    /// Name of its kind.
    pub kind: String,
    /// 0.15 to 1.
    pub severity: f64,
    /// Strand it is on.
    pub strand: usize,
    /// Wire of the strand.
    pub wire: usize,
    /// The view.
    pub view: usize,
    /// First line.
    pub first_line: usize,
    /// Last line.
    pub last_line: usize,
    /// First column.
    pub first_column: usize,
    /// Last column.
    pub last_column: usize,
    /// Whether every inspector would mark it.
    pub clear: bool,
}

/// Area of a run in mm2 below which no inspector would swear to it.
const CLEAR_MM2: f64 = 1.1;
/// Width in mm below which a run is a sliver at the rope's edge.
const CLEAR_WIDTH_MM: f64 = 0.5;
/// Rope in mm without any sign that ends a run.
const GAP_MM: f64 = 1.2;
/// Shorter runs, in mm, are not marked.
const SHORTEST_MM: f64 = 0.3;

/// All labels of a scene, by defect, view and line.
pub fn labels(scene: &Scene) -> Vec<Label> {
    if scene.recipe().kind == Kind::Artificial {
        return Vec::new();
    }
    let jobs: Vec<(usize, usize)> =
        (0..scene.defects().len()).flat_map(|d| (0..scene.views()).map(move |v| (d, v))).collect();
    jobs.into_par_iter().flat_map_iter(|(defect, view)| labels_of(scene, defect, view)).collect()
}

fn labels_of(scene: &Scene, index: usize, view: usize) -> Vec<Label> {
    let defect = &scene.defects()[index];
    let pitch_mm = scene.recipe().line_pitch_mm;
    let column_mm = scene.recipe().diameter_mm / scene.recipe().rope_width_px;
    let reach_mm = defect.half_mm + 12.0;
    let first = ((defect.centre_mm - reach_mm) / pitch_mm).max(0.0) as usize;
    let end = (((defect.centre_mm + reach_mm) / pitch_mm) as usize).min(scene.lines());
    let near = defects::near(scene.defects(), defect.centre_mm - reach_mm, defect.centre_mm + reach_mm);
    let mut painter = LinePainter::new(scene, view);
    let mut runs: Vec<(Label, usize)> = Vec::new();
    for line in first..end {
        let (mut low, mut high, mut pixels) = (usize::MAX, 0, 0);
        painter.sightings(line, &near, |column, seen| {
            if seen == index {
                (low, high, pixels) = (low.min(column), high.max(column), pixels + 1);
            }
        });
        if pixels < 2 {
            continue;
        }
        match runs.last_mut() {
            Some((label, area)) if (line - label.last_line) as f64 * pitch_mm <= GAP_MM => {
                label.last_line = line;
                label.first_column = label.first_column.min(low);
                label.last_column = label.last_column.max(high);
                *area += pixels;
            }
            _ => runs.push((
                Label {
                    defect: defect.id,
                    kind: defect.kind.name().into(),
                    severity: (defect.severity * 1000.0).round() / 1000.0,
                    strand: defect.strand,
                    wire: defect.wire,
                    view,
                    first_line: line,
                    last_line: line,
                    first_column: low,
                    last_column: high,
                    clear: false,
                },
                pixels,
            )),
        }
    }
    runs.retain(|(label, _)| (label.last_line - label.first_line + 1) as f64 * pitch_mm >= SHORTEST_MM - 1e-9);
    runs.into_iter()
        .map(|(label, area)| Label {
            clear: area as f64 * pitch_mm * column_mm >= CLEAR_MM2
                && (label.last_column - label.first_column + 1) as f64 * column_mm >= CLEAR_WIDTH_MM,
            ..label
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Recipe;

    #[test]
    fn every_defect_can_be_seen_and_lies_inside_the_rope() {
        let recipe = Recipe { defects: 8, metres: 1.6, ..Recipe::photographic() };
        let scene = Scene::new(&recipe, 21).unwrap();
        let labels = labels(&scene);
        for defect in scene.defects() {
            let own: Vec<_> = labels.iter().filter(|l| l.defect == defect.id).collect();
            assert!(!own.is_empty() && own.len() < 16, "{defect:?}: {}", own.len());
            assert!(own.iter().any(|l| l.clear) || defect.severity < 0.4, "{defect:?} {own:?}");
        }
        assert!(labels.iter().all(|l| l.first_column > 30 && l.last_column < 450 && l.last_line < scene.lines()));
    }
}
