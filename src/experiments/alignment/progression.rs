//! Tracking: lay lengths that change along the rope, estimate against truth. [Wacker13, fig. 6c, d]

use super::super::ExperimentError;
use super::super::page::{Page, number};
use super::super::trial;
use super::super::work::Work;
use super::bounds::{self, JOINED};
use super::noise;
use super::plan::Plan;
use crate::drawing::chart::{COLOURS, Chart, Mark, Scale};
use crate::evaluate::bound::mean_abs;
use crate::evaluate::lay_lengths::{ErrorStatistics, MeasuredLay, ScoredStretch};
use crate::simulate::Scene;

/// Noise of the experiment.
const NOISE: (f64, f64) = (1.0, 10.0);
/// What the paper reports in mm: strands, wires.
const PAPER_MM: (f64, f64) = (0.06, 0.23);

/// Tracks one rope and writes the section.
pub(super) fn report(plan: &Plan, work: &Work<'_>, page: &mut Page) -> Result<(), ExperimentError> {
    let recipe = noise::recipe(plan.tracked_m, NOISE);
    let scene = Scene::new(&recipe, plan.seed_of("tracking", 0))?;
    let trial = trial::run(&scene, recipe.strand_lay_mm, &work.run(plan.tracked_m))?;
    page.heading("Tracking a progression (figure 6c, d)");
    page.paragraph(&format!(
        "One rope of {} m, contour noise {} px, gray noise {}: the gray band is the true lay of every stretch, the line the estimate. \
         The paper reports mean errors of {} mm and {} mm over 100 such ropes.",
        plan.tracked_m, NOISE.0, NOISE.1, PAPER_MM.0, PAPER_MM.1
    ));
    let pitch_m = recipe.line_pitch_mm / 1000.0;
    let at_m = |s: &ScoredStretch| (s.first_line + s.last_line) as f64 / 2.0 * pitch_m;
    let strand: Vec<(f64, Option<MeasuredLay>)> = trial.stretches.iter().map(|s| (at_m(s), s.strand)).collect();
    let wire: Vec<_> = trial.stretches.iter().map(|s| (at_m(s), s.wires.first().copied().flatten())).collect();
    let charts = [("c  strand lay", "strand lay, mm", &strand), ("d  wire lay of one strand", "wire lay, mm", &wire)];
    let charts = charts.map(|(title, label, values)| progression(title, label, values, plan.tracked_m));
    page.figure("tracking", "Tracking of lay lengths", &charts, 2);
    let first = trial.stretches.first();
    let lines = first.map_or(0, |s| s.last_line - s.first_line + 1);
    let image = first.map(|s| bounds::image(&scene, &trial, s)).transpose()?.flatten();
    let errors = |errors: Vec<f64>| ErrorStatistics::of(&errors).map(|e| (e.mean_abs, e.n));
    let strand_error = errors(trial.strand_errors_mm().collect());
    let wire_error = errors(trial.wire_errors_mm().collect());
    let row = |name: &str, paper: f64, error: Option<(f64, usize)>, bounds: [Option<f64>; 3]| {
        let [frame, joined, all] = bounds;
        let ratio = number(error.zip(frame.or(all)).map(|((e, _), b)| e / b), 2);
        let n = error.map_or(0, |e| e.1).to_string();
        let mean = number(error.map(|e| e.0), 4);
        [name.into(), n, paper.to_string(), mean, number(frame, 4), number(joined, 4), number(all, 5), ratio]
    };
    page.table(
        [
            "lay",
            "estimates",
            "paper, mm",
            "mean error, mm",
            "bound frame by frame",
            "bound of three stretches",
            "bound of all gray values",
            "error / first bound",
        ],
        [
            row(
                "strands",
                PAPER_MM.0,
                strand_error,
                [
                    bounds::frame_wise_mm(&scene, &trial),
                    bounds::smoothed_mm(&recipe, JOINED, lines),
                    image.map(|b| mean_abs(b.strand_mm)),
                ],
            ),
            row("wires", PAPER_MM.1, wire_error, [None, None, image.map(|b| mean_abs(b.wire_mm))]),
        ],
    );
    let cell = |lay: &Option<MeasuredLay>, of: fn(&MeasuredLay) -> f64| number(lay.as_ref().map(of), 4);
    let rows = strand.iter().zip(&wire).map(|((at, s), (_, w))| {
        let [a, b] = [s, w].map(|lay| [cell(lay, |l| l.estimate_mm), cell(lay, |l| l.true_mm)]);
        let ([a, b], [c, d]) = (a, b);
        [number(Some(*at), 3), a, b, c, d]
    });
    page.numbers(
        "tracking",
        ["position_m", "strand_lay_mm", "true_strand_lay_mm", "wire_lay_mm", "true_wire_lay_mm"],
        rows,
    );
    Ok(())
}

/// The band of the truth and the line of the estimate.
pub(super) fn progression(title: &str, label: &str, values: &[(f64, Option<MeasuredLay>)], metres: f64) -> Chart {
    let known = || values.iter().filter_map(|(at, lay)| Some((*at, (*lay)?)));
    let vertical = Scale::around(known().flat_map(|(_, lay)| [lay.estimate_mm, lay.true_mm]));
    Chart {
        title: title.into(),
        x_label: "rope, m".into(),
        y_label: label.into(),
        horizontal: Scale::linear(0.0, metres),
        vertical,
        marks: vec![
            Mark::Band {
                points: known().map(|(at, lay)| (at, lay.true_mm, lay.true_mm)).collect(),
                colour: COLOURS[5],
                label: "truth".into(),
            },
            Mark::Curve {
                points: values.iter().map(|(at, lay)| (*at, lay.map_or(f64::NAN, |l| l.estimate_mm))).collect(),
                colour: COLOURS[0],
                dashed: false,
                label: "estimate".into(),
            },
        ],
    }
}
