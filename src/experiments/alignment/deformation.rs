//! A known deformation added to the images of a rope, and recovered. [Wacker13, sec. 6.2 and 6.3.3]

use super::super::ExperimentError;
use super::super::frames::HeldFrames;
use super::super::page::{Page, number};
use super::super::trial::{self, Trial};
use super::super::work::Work;
use super::plan::{BRIEF_M, Plan};
use super::{bounds, short_rope};
use crate::drawing::chart::{COLOURS, Chart, Mark, Scale};
use crate::evaluate::bound::mean_abs;
use crate::evaluate::lay_lengths::{MeasuredLay, ScoredStretch};
use crate::pipeline::PipelineError;
use crate::simulate::Scene;
use crate::simulate::curve::SmoothCurve;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Farthest that a deformation moves a line, in px.
const REACH_PX: f64 = 4.0;
/// Waves of a deformation in mm: faster than a rope sways, slower than a wire's pitch.
const WAVES_MM: std::ops::Range<f64> = 60.0..1000.0;

/// What came of one deformation.
struct Recovery {
    rms_px: f64,
    strand_mm: Vec<f64>,
    wire_mm: Vec<f64>,
}

/// Deforms one rope many times and writes the section.
pub(super) fn report(plan: &Plan, work: &Work<'_>, page: &mut Page) -> Result<(), ExperimentError> {
    let recipe = short_rope::recipe(short_rope::NOMINAL_MM, BRIEF_M);
    let scene = Scene::new(&recipe, plan.seed_of("deformation", 0))?;
    let frames = HeldFrames::render(&scene).map_err(PipelineError::from)?;
    let run = |frames: &HeldFrames| trial::run_frames(&scene, frames, short_rope::NOMINAL_MM, &work.run(BRIEF_M));
    let plain = run(&frames)?;
    let mut recoveries = Vec::new();
    let mut shown = None;
    for n in 0..plan.many() {
        let mut rng = ChaCha8Rng::seed_from_u64(plan.seed_of("deformation", n));
        let added = SmoothCurve::waves(&mut rng, 0.0, REACH_PX, WAVES_MM, 5);
        let added_px = |line: usize| added.value(line as f64 * recipe.line_pitch_mm);
        let deformed = run(&frames.deformed(added_px))?;
        let (recovery, course) = compare(&plain, &deformed, added_px);
        shown.get_or_insert(course);
        recoveries.push(recovery);
    }
    page.heading("Recovery of a known deformation");
    page.paragraph(&format!(
        "The paper's protocol: the correction of a rope's images is computed, a known sideways deformation is added to the images \
         and the correction computed again; the difference of both corrections should be what was added. {} random deformations of up \
         to {REACH_PX} px (the paper: 100) on {BRIEF_M} m of the short rope. Both runs see the same noise.",
        plan.many()
    ));
    if let Some(course) = shown {
        page.figure("deformation", "A deformation and its recovery", &charts(&course, recipe.line_pitch_mm), 2);
    }
    let bound = plain.stretches.first().map(|s| bounds::image(&scene, &plain, s)).transpose()?.flatten();
    let n = recoveries.len() as f64;
    let rms_px = recoveries.iter().map(|r| r.rms_px).sum::<f64>() / n;
    let mean = |of: fn(&Recovery) -> &Vec<f64>| {
        let all: Vec<f64> = recoveries.iter().flat_map(|r| of(r).iter().copied()).collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    page.table(
        ["", "paper", "here", "bound of all gray values, one recording"],
        [
            [
                "rms of the deformation, px".into(),
                "0.15".into(),
                number(Some(rms_px), 3),
                number(bound.map(|b| b.displacement_px), 4),
            ],
            [
                "mean change of strand lays, mm".into(),
                "0.32".into(),
                number(Some(mean(|r| &r.strand_mm)), 4),
                number(bound.map(|b| mean_abs(b.strand_mm)), 5),
            ],
            [
                "mean change of wire lays, mm".into(),
                "0.84".into(),
                number(Some(mean(|r| &r.wire_mm)), 4),
                number(bound.map(|b| mean_abs(b.wire_mm)), 5),
            ],
        ],
    );
    let rows = recoveries.iter().enumerate().map(|(n, r)| {
        let mean = |of: &Vec<f64>| of.iter().sum::<f64>() / of.len() as f64;
        [
            n.to_string(),
            number(Some(r.rms_px), 4),
            number(Some(mean(&r.strand_mm)), 4),
            number(Some(mean(&r.wire_mm)), 4),
        ]
    });
    page.numbers("deformation", ["deformation", "rms_px", "strand_change_mm", "wire_change_mm"], rows);
    Ok(())
}

/// (line, added px, recovered px), both less their mean.
type Course = Vec<(usize, f64, f64)>;

fn compare(plain: &Trial, deformed: &Trial, added_px: impl Fn(usize) -> f64) -> (Recovery, Course) {
    let both = plain.displacement_px.iter().zip(&deformed.displacement_px).enumerate();
    let mut course: Course =
        both.map(|(line, (p, d))| (line, added_px(line), d - p)).filter(|(_, _, r)| r.is_finite()).collect();
    let n = course.len() as f64;
    let (added, recovered) = course.iter().fold((0.0, 0.0), |(a, r), p| (a + p.1 / n, r + p.2 / n));
    for point in &mut course {
        point.1 -= added;
        point.2 -= recovered;
    }
    let rms_px = (course.iter().map(|p| (p.2 - p.1).powi(2)).sum::<f64>() / n).sqrt();
    let change = |of: &dyn Fn(&ScoredStretch) -> Vec<Option<MeasuredLay>>| {
        let pairs = plain.stretches.iter().zip(&deformed.stretches).flat_map(|(p, d)| of(p).into_iter().zip(of(d)));
        pairs.filter_map(|(p, d)| Some((d?.estimate_mm - p?.estimate_mm).abs())).collect()
    };
    let (strand_mm, wire_mm) = (change(&|s| vec![s.strand]), change(&|s| s.wires.clone()));
    (Recovery { rms_px, strand_mm, wire_mm }, course)
}

fn charts(course: &Course, pitch_mm: f64) -> [Chart; 2] {
    let at_m = |line: usize| line as f64 * pitch_mm / 1000.0;
    let every = || course.iter().step_by(25);
    let metres = course.last().map_or(1.0, |p| at_m(p.0));
    let curve = |points, colour, dashed, label: &str| Mark::Curve { points, colour, dashed, label: label.into() };
    let error: Vec<(f64, f64)> = every().map(|p| (at_m(p.0), p.2 - p.1)).collect();
    let chart = |title: &str, vertical, marks| Chart {
        title: title.into(),
        x_label: "rope, m".into(),
        y_label: "px".into(),
        horizontal: Scale::linear(0.0, metres),
        vertical,
        marks,
    };
    [
        chart(
            "deformation added and recovered",
            Scale::around(every().flat_map(|p| [p.1, p.2])),
            vec![
                curve(every().map(|p| (at_m(p.0), p.1)).collect(), COLOURS[1], false, "added"),
                curve(every().map(|p| (at_m(p.0), p.2)).collect(), COLOURS[0], true, "recovered"),
            ],
        ),
        chart(
            "difference of both",
            Scale::around(error.iter().map(|p| p.1)),
            vec![curve(error.clone(), COLOURS[0], false, "recovered less added")],
        ),
    ]
}
