//! Alignment of the strands with the contours of a stretch. [Wacker13, sec. 3.3.1 (4), eq. 13]

use super::contour::Contours;
use super::model_contour::ModelContour;
use super::simplex::{Minimum, Termination, minimise};
use std::f64::consts::TAU;

/// Contours of one view over a stretch, and the outline that the model has in that view.
#[derive(Debug, Clone, Copy)]
pub struct ContourView<'a> {
    /// What was seen.
    pub contours: &'a Contours,
    /// What the model looks like.
    pub model: &'a ModelContour,
    /// Angle of the view in rad.
    pub angle_rad: f64,
}

/// Strand parameters of a stretch, p_s in a form that does not depend on where x = 0 lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrandAlignment {
    /// Phase of strand 0 at the middle of the stretch in rad, rope axes.
    pub phase_rad: f64,
    /// Rate 2 pi/L_s in rad/mm, signed.
    pub rate_rad_per_mm: f64,
    /// Mean correlation of real and model contours (eq. 13 divided by the number of contours): 1 is perfect.
    pub score: f64,
    /// Number of evaluations of eq. 13.
    pub evaluations: usize,
    /// Why the optimiser stopped.
    pub termination: Termination,
}

/// About so many lines of a stretch, equally far apart, are asked: the strands' outline is smooth over a wire's width.
const MOST_LINES: usize = 120;
/// Fewest usable lines of these for a correlation to mean anything.
const FEWEST_LINES: usize = 24;

/// The lines of a view that eq. 13 is evaluated at.
struct SeenWidths<'a> {
    model: &'a ModelContour,
    angle_rad: f64,
    /// Distance from the middle of the stretch in mm, and width of the rope in px.
    lines: Vec<(f64, f64)>,
}

impl<'a> SeenWidths<'a> {
    fn of(view: &ContourView<'a>, pitch_mm: f64) -> Self {
        let n = view.contours.len();
        let middle = (n as f64 - 1.0) / 2.0;
        let width = |k: usize| f64::from(view.contours.upper_px[k]) - f64::from(view.contours.lower_px[k]);
        let lines = (0..n).step_by((n / MOST_LINES).max(1)).map(|k| ((k as f64 - middle) * pitch_mm, width(k)));
        Self { model: view.model, angle_rad: view.angle_rad, lines: lines.filter(|(_, w)| w.is_finite()).collect() }
    }
}

/// NCC of real and model contours, corrected by eq. 10, averaged over all contours of all views (eq. 13); `None` without lines.
///
/// The phase at a line is `phase_rad` + rate * distance from the middle. With the axis of eq. 10, half of the rope's width is left
/// of the real contours on either side of the middle between the model's (eq. 11-12).
fn contour_score(views: &[SeenWidths], phase_rad: f64, rate_rad_per_mm: f64) -> Option<f64> {
    let mut total = 0.0;
    let mut contours = 0;
    for view in views {
        let mut upper = Correlation::default();
        let mut lower = Correlation::default();
        for (off_mm, width) in &view.lines {
            let phase = phase_rad + rate_rad_per_mm * off_mm - view.angle_rad;
            let (model_lower, model_upper) = view.model.edges_px(phase);
            let middle = (model_upper + model_lower) / 2.0;
            upper.add(middle + width / 2.0, model_upper);
            lower.add(middle - width / 2.0, model_lower);
        }
        if let (Some(a), Some(b)) = (upper.coefficient(), lower.coefficient()) {
            total += a + b;
            contours += 2;
        }
    }
    (contours > 0).then(|| total / f64::from(contours))
}

#[derive(Default)]
struct Correlation {
    n: f64,
    a: f64,
    b: f64,
    aa: f64,
    bb: f64,
    ab: f64,
}

impl Correlation {
    fn add(&mut self, a: f64, b: f64) {
        self.n += 1.0;
        self.a += a;
        self.b += b;
        self.aa += a * a;
        self.bb += b * b;
        self.ab += a * b;
    }

    fn coefficient(&self) -> Option<f64> {
        if self.n < FEWEST_LINES as f64 {
            return None;
        }
        let covariance = self.ab - self.a * self.b / self.n;
        let variances = (self.aa - self.a * self.a / self.n) * (self.bb - self.b * self.b / self.n);
        (variances > 0.0).then(|| covariance / variances.sqrt())
    }
}

/// Polishes a start with the downhill simplex. `None` if the views show too few lines.
pub fn polish(views: &[ContourView], pitch_mm: f64, phase_rad: f64, rate_rad_per_mm: f64) -> Option<StrandAlignment> {
    let seen: Vec<SeenWidths> = views.iter().map(|view| SeenWidths::of(view, pitch_mm)).collect();
    let length_mm = views.first()?.contours.len() as f64 * pitch_mm;
    polish_seen(&seen, length_mm, phase_rad, rate_rad_per_mm)
}

fn polish_seen(seen: &[SeenWidths], length_mm: f64, phase_rad: f64, rate_rad_per_mm: f64) -> Option<StrandAlignment> {
    contour_score(seen, phase_rad, rate_rad_per_mm)?;
    let step_rad = seen[0].model.step_rad();
    let Minimum { at, cost, evaluations, termination } = minimise(
        |p: &[f64; 2]| -contour_score(seen, p[0], p[1]).unwrap_or(-1.0),
        [phase_rad, rate_rad_per_mm],
        [0.03 * step_rad, 0.06 * step_rad / length_mm],
        1e-3,
        200,
    );
    Some(StrandAlignment { phase_rad: at[0], rate_rad_per_mm: at[1], score: -cost, evaluations, termination })
}

/// Phases of the grid, over one period of the outline.
const PHASES: usize = 16;
/// Summits of the grid that are polished, the highest first.
const MOST_SUMMITS: usize = 6;

/// Searches all phases and the lay lengths `lay_mm` (signed, same hand), then polishes the summits of the grid: the paper's
/// global grid search before the simplex. The answer is refused at the edge of the grid, for an edge is never an answer.
pub fn search(views: &[ContourView], pitch_mm: f64, lay_mm: (f64, f64)) -> Option<StrandAlignment> {
    let length_mm = views.first()?.contours.len() as f64 * pitch_mm;
    let step_rad = views[0].model.step_rad();
    let seen: Vec<SeenWidths> = views.iter().map(|view| SeenWidths::of(view, pitch_mm)).collect();
    let (low, high) = (TAU / lay_mm.1, TAU / lay_mm.0);
    // Between grid points the phase at the ends of the stretch moves by an eighth of the outline's period.
    let spacing = 0.25 * step_rad / length_mm;
    let rates = ((high - low).abs() / spacing).ceil().max(1.0) as usize;
    let rate_at = |r: usize| low + (high - low) * r as f64 / rates as f64;
    let phase_at = |p: usize| step_rad * p as f64 / PHASES as f64;
    let grid = (0..=rates)
        .map(|r| (0..PHASES).map(|p| contour_score(&seen, phase_at(p), rate_at(r))).collect::<Option<Vec<f64>>>())
        .collect::<Option<Vec<_>>>()?;
    let best = summits(&grid)
        .into_iter()
        .take(MOST_SUMMITS)
        .filter_map(|(r, p)| polish_seen(&seen, length_mm, phase_at(p), rate_at(r)))
        .filter(|a| {
            let (least, most) = (low.min(high), low.max(high));
            let slack = 0.02 * (most - least);
            a.rate_rad_per_mm >= least - slack && a.rate_rad_per_mm <= most + slack
        })
        .max_by(|a, b| a.score.total_cmp(&b.score))?;
    Some(StrandAlignment { evaluations: grid.len() * PHASES + best.evaluations, ..best })
}

/// (rate, phase) of the grid points that no neighbour exceeds, the highest first; phases are cyclic.
fn summits(grid: &[Vec<f64>]) -> Vec<(usize, usize)> {
    let is_summit = |&(r, p): &(usize, usize)| {
        let rates = r.saturating_sub(1)..=(r + 1).min(grid.len() - 1);
        let about = |r: usize| [p + PHASES - 1, p, p + 1].map(|p| grid[r][p % PHASES]);
        rates.flat_map(about).all(|near| near <= grid[r][p])
    };
    let points = (0..grid.len()).flat_map(|r| (0..PHASES).map(move |p| (r, p)));
    let mut summits: Vec<(usize, usize)> = points.filter(is_summit).collect();
    summits.sort_by(|&(r, p), &(s, q)| grid[s][q].total_cmp(&grid[r][p]));
    summits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::Camera;
    use crate::vision::rope::RopeDesign;

    #[test]
    fn recovers_phase_and_lay_from_noisy_contours_of_an_oscillating_rope() {
        let rope = RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 20.46,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap();
        let camera = Camera { angle_rad: 0.0, distance_mm: 300.0, px_per_mm: 18.0 };
        let model = ModelContour::new(&rope, &camera);
        let (rate, phase, n) = (TAU / 137.5, 0.4, 2000);
        let mut contours = Contours::default();
        for k in 0..n {
            let p = phase + rate * (k as f64 - 999.5) * 0.1;
            let sway = 6.0 * (k as f64 / 300.0).sin();
            let noise = ((k * 7919 % 101) as f64 / 50.0 - 1.0, (k * 104_729 % 101) as f64 / 50.0 - 1.0);
            contours.lower_px.push((240.0 + sway + model.edge_px(1, p) + noise.0) as f32);
            contours.upper_px.push((240.0 + sway + model.edge_px(0, p) + noise.1) as f32);
        }
        let views = [ContourView { contours: &contours, model: &model, angle_rad: 0.0 }];
        let found = search(&views, 0.1, (110.0, 165.0)).unwrap();
        assert!((TAU / found.rate_rad_per_mm - 137.5).abs() < 0.3, "{}", TAU / found.rate_rad_per_mm);
        let off = (found.phase_rad - phase) / rope.strand_step_rad();
        assert!((off - off.round()).abs() < 0.02, "{off}");
        assert!(found.score > 0.95);
    }
}
