//! ShortRope: one rope of 20.46 mm as it was, twisted open and twisted shut; a photographic look. [Wacker13, fig. 7]
//! And how much estimates differ when the same rope is recorded again.

use super::super::ExperimentError;
use super::super::page::{Page, number, percent};
use super::super::trial::{self, Trial};
use super::super::work::Work;
use super::bounds;
use super::plan::Plan;
use super::progression::progression;
use crate::evaluate::bound::mean_abs;
use crate::evaluate::lay_lengths::{ErrorStatistics, MeasuredLay, ScoredStretch};
use crate::simulate::{Recipe, Scene};

/// What the maker states in mm, and the program is told.
pub(super) const NOMINAL_MM: f64 = 137.5;
/// The sequences and the strand lay that the paper's expert measured by hand in mm.
const SEQUENCES: [(&str, f64); 3] = [("Seq. 1", 136.6), ("Seq. 2", 139.5), ("Seq. 3", 133.0)];

/// A ShortRope with a strand lay about `lay_mm`: clean, in one view, hardly drifting.
pub(super) fn recipe(lay_mm: f64, metres: f64) -> Recipe {
    Recipe {
        diameter_mm: 20.46,
        strand_lay_mm: lay_mm,
        strand_lay_drift_mm: 0.7,
        wire_lay_mm: -79.0,
        wire_lay_drift_mm: 1.5,
        camera_distance_mm: 7.0 * 20.46,
        view_angles_deg: vec![0.0],
        metres,
        ..Recipe::photographic()
    }
}

/// Runs the sequences and writes the section.
pub(super) fn report(plan: &Plan, work: &Work<'_>, page: &mut Page) -> Result<(), ExperimentError> {
    page.heading("Three sequences of a short rope (figure 7)");
    page.paragraph(&format!(
        "The ShortRope protocol on simulated photographs: 6x9, 20.46 mm, {} m, one view, round wires under lamps, moderate dirt, \
         oscillation of 4 px; the program is told a lay of {NOMINAL_MM} mm, the true ones lie about what the paper's expert \
         measured by hand. The paper's estimates vary by about 1 mm about them.",
        plan.short_m
    ));
    let mut charts = Vec::new();
    let mut rows = Vec::new();
    let mut numbers = Vec::new();
    for (name, lay_mm) in SEQUENCES {
        let recipe = recipe(lay_mm, plan.short_m);
        let scene = Scene::new(&recipe, plan.seed_of("short", 0))?;
        let trial = trial::run(&scene, NOMINAL_MM, &work.run(plan.short_m))?;
        let values: Vec<(f64, Option<MeasuredLay>)> = trial
            .stretches
            .iter()
            .map(|s| ((s.first_line + s.last_line) as f64 / 2.0 * recipe.line_pitch_mm / 1000.0, s.strand))
            .collect();
        charts.push(progression(name, "strand lay, mm", &values, plan.short_m));
        for (at, lay) in &values {
            let of = |f: fn(&MeasuredLay) -> f64| number(lay.as_ref().map(f), 4);
            numbers.push([name.into(), number(Some(*at), 3), of(|l| l.estimate_mm), of(|l| l.true_mm)]);
        }
        rows.push(sequence_row(name, &scene, &trial)?);
    }
    page.figure("short-rope", "Strand lays of three sequences", &charts, 3);
    page.table(
        [
            "sequence",
            "true lay, mm",
            "estimate, mm",
            "mean error, mm",
            "largest",
            "bound of all gray values",
            "wires: mean error, mm",
            "bound of all gray values",
        ],
        rows,
    );
    page.paragraph(
        "The bound knows the sensor's noise only and takes the look of every wire, its dirt and its light as known; an estimator \
         has to learn them, so the distance to the bound is what texture costs.",
    );
    page.numbers("short-rope", ["sequence", "position_m", "strand_lay_mm", "true_strand_lay_mm"], numbers);
    Ok(())
}

fn sequence_row(name: &str, scene: &Scene, trial: &Trial) -> Result<[String; 8], ExperimentError> {
    let strand = ErrorStatistics::of(&trial.strand_errors_mm().collect::<Vec<_>>());
    let wire = ErrorStatistics::of(&trial.wire_errors_mm().collect::<Vec<_>>());
    let largest = trial.strand_errors_mm().map(f64::abs).fold(f64::NAN, f64::max);
    let known: Vec<MeasuredLay> = trial.stretches.iter().filter_map(|s| s.strand).collect();
    let mean = |of: fn(&MeasuredLay) -> f64| known.iter().map(of).sum::<f64>() / known.len() as f64;
    let bound = trial.stretches.first().map(|s| bounds::image(scene, trial, s)).transpose()?.flatten();
    Ok([
        name.into(),
        number(Some(mean(|l| l.true_mm)), 2),
        number(Some(mean(|l| l.estimate_mm)), 2),
        number(strand.map(|e| e.mean_abs), 3),
        number(Some(largest), 3),
        number(bound.map(|b| mean_abs(b.strand_mm)), 5),
        number(wire.map(|e| e.mean_abs), 3),
        number(bound.map(|b| mean_abs(b.wire_mm)), 5),
    ])
}

/// Records the first sequence again and again, and writes how much the estimates differ.
pub(super) fn repeatability(plan: &Plan, work: &Work<'_>, page: &mut Page) -> Result<(), ExperimentError> {
    let recipe = recipe(SEQUENCES[0].1, plan.short_m);
    let mut trials = Vec::new();
    for recording in 0..plan.recordings {
        let scene = Scene::new(&recipe, plan.seed_of("short", 0))?;
        let again = scene.recorded_again(plan.seed_of("repeatability", recording));
        trials.push((trial::run(&again, NOMINAL_MM, &work.run(plan.short_m))?, again));
    }
    page.heading("Repeatability");
    page.paragraph(&format!(
        "Seq. 1 recorded {} times with other noise: standard deviation over mean, averaged over the stretches. The paper's figures are \
         of 10 runs over one recording; on one recording, ours gives the same bits every time.",
        plan.recordings
    ));
    let all: Vec<&Trial> = trials.iter().map(|(trial, _)| trial).collect();
    let strand = variation(&all, |s| vec![s.strand]);
    let wire = variation(&all, |s| s.wires.clone());
    let bound = match trials.first() {
        Some((trial, scene)) => trial.stretches.first().map(|s| bounds::image(scene, trial, s)).transpose()?.flatten(),
        None => None,
    };
    page.table(
        ["lay", "paper", "variation coefficient", "bound of all gray values"],
        [
            [
                "strands".into(),
                "0.0028 %".into(),
                percent(strand, 4),
                percent(bound.map(|b| b.strand_mm / recipe.strand_lay_mm.abs()), 5),
            ],
            [
                "wires".into(),
                "3.3 %".into(),
                percent(wire, 4),
                percent(bound.map(|b| b.wire_mm / recipe.wire_lay_mm.abs()), 5),
            ],
        ],
    );
    Ok(())
}

/// Standard deviation over mean of every lay over the recordings, averaged; `None` with fewer than two recordings of any.
fn variation(trials: &[&Trial], lays: impl Fn(&ScoredStretch) -> Vec<Option<MeasuredLay>>) -> Option<f64> {
    let stretches = trials.iter().map(|t| t.stretches.len()).min()?;
    let mut ratios = Vec::new();
    for stretch in 0..stretches {
        let of: Vec<_> = trials.iter().map(|t| lays(&t.stretches[stretch])).collect();
        for lay in 0..of.first().map_or(0, Vec::len) {
            let values: Vec<f64> = of.iter().filter_map(|o| Some(o[lay]?.estimate_mm)).collect();
            let n = values.len() as f64;
            if n < 2.0 {
                continue;
            }
            let mean = values.iter().sum::<f64>() / n;
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
            ratios.push(variance.sqrt() / mean.abs());
        }
    }
    (!ratios.is_empty()).then(|| ratios.iter().sum::<f64>() / ratios.len() as f64)
}
