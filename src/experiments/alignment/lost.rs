//! Lost locks: random ropes at the highest noise, and in how many a lay length is absent or of another rope.

use super::super::ExperimentError;
use super::super::page::{Page, number};
use super::super::trial;
use super::super::work::Work;
use super::noise::{self, LEVELS};
use super::plan::{BRIEF_M, Plan};
use crate::evaluate::lay_lengths::ErrorStatistics;
use crate::simulate::Scene;

/// Error of a strand lay in mm beyond which the lock was lost: many times the noise, far less than a wrong period gives.
const LOST_STRAND_MM: f64 = 1.0;
/// The same of a wire lay.
const LOST_WIRE_MM: f64 = 1.0;

/// Tries the ropes and writes the section.
pub(super) fn report(plan: &Plan, work: &Work<'_>, page: &mut Page) -> Result<(), ExperimentError> {
    let noise = LEVELS[LEVELS.len() - 1];
    let recipe = noise::recipe(BRIEF_M, noise);
    let mut strand_mm: Vec<f64> = Vec::new();
    let mut wire_mm: Vec<f64> = Vec::new();
    let (mut strands_lost, mut wires_lost, mut absent) = (0, 0, (0, 0));
    for rope in 0..plan.many() {
        let scene = Scene::new(&recipe, plan.seed_of("lost", rope))?;
        let trial = trial::run(&scene, recipe.strand_lay_mm, &work.run(BRIEF_M))?;
        let missing = trial.absent();
        absent = (absent.0 + missing.0, absent.1 + missing.1);
        let off = |mut errors: Box<dyn Iterator<Item = f64> + '_>, limit: f64| errors.any(|e| e.abs() > limit);
        strands_lost += usize::from(missing.0 > 0 || off(Box::new(trial.strand_errors_mm()), LOST_STRAND_MM));
        wires_lost += usize::from(missing.1 > 0 || off(Box::new(trial.wire_errors_mm()), LOST_WIRE_MM));
        strand_mm.extend(trial.strand_errors_mm());
        wire_mm.extend(trial.wire_errors_mm());
    }
    page.heading("Lost locks at high noise");
    page.paragraph(&format!(
        "{} random ropes of {BRIEF_M} m, contour noise {} px, gray noise {}. Lost is a rope of which any lay is absent or off by more \
         than {LOST_STRAND_MM} mm (strands) or {LOST_WIRE_MM} mm (wires).",
        plan.many(),
        noise.0,
        noise.1
    ));
    let row = |name: &str, lost: usize, absent: usize, errors: &[f64]| {
        let errors = ErrorStatistics::of(errors);
        let largest = |e: Option<ErrorStatistics>| number(e.map(|e| e.p95_abs), 3);
        [name.into(), lost.to_string(), absent.to_string(), number(errors.map(|e| e.mean_abs), 4), largest(errors)]
    };
    page.table(
        ["lay", "ropes lost", "estimates absent", "mean error, mm", "95 %"],
        [row("strands", strands_lost, absent.0, &strand_mm), row("wires", wires_lost, absent.1, &wire_mm)],
    );
    Ok(())
}
