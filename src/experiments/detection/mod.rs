//! `evaluate detection`: how surely defects are found, and what that costs in rope to look at again. [Wacker13, sec. 6.4]

mod ablation; // from the paper's configuration to ours
mod figures; // ROC curves and what defects need, as charts
mod judged; // everything that is known of one run
mod ladder; // configurations from the paper's to ours
mod plan; // how much rope
mod rope; // the simulated rope: trained, inspected
mod tables; // the same as tables

pub use plan::Plan;

use super::page::{Page, check_folder, number};
use super::work::Work;
use super::{ExperimentError, Provenance};
use crate::pipeline::Progress;
use judged::Judged;
use ladder::{LADDER, OURS, Rung};
use std::path::{Path, PathBuf};

/// Name of the work in progress reports.
pub const STAGE: &str = "detection";

const TITLE: &str = "How surely defects are found";

/// Simulates a rope, trains and inspects, and writes the report into `folder`; answers its page.
pub fn report(
    folder: &Path,
    plan: &Plan,
    made: &Provenance,
    progress: &dyn Progress,
) -> Result<PathBuf, ExperimentError> {
    check_folder(folder)?;
    let rungs: &[Rung] = if plan.ablation { &LADDER } else { &[OURS] };
    let work = Work::new(progress, STAGE, rope::worth_m(rungs, plan.train_m, plan.metres));
    let mut page = Page::new(folder, TITLE, made, Some(plan.seed))?;
    let runs = rope::TestRope::new(plan)?.judged(rungs, &work)?;
    let ours = runs.last().expect("every rung is judged, and the last is ours");
    page.paragraph(&format!(
        "The experiment of Wacker & Denzler (section 6.4) on simulated rope: 6x9, 32 mm, lay 220 mm, {} views of {} columns, moderate dirt, oil, \
         water, drifting light. Trained on the first {} m, which are intact, tested on the other {} m with {} defects of eight kinds \
         planted with severities from hardly visible (0.15) to plain (1). The paper has 395 m of a real rope with 37 defects. A defect \
         counts if one of its labels is clear: {} do. Lines near a label count neither way.",
        plan.views,
        plan.sensor_px,
        plan.train_m,
        number(Some(plan.metres - plan.train_m), 1),
        plan.defects,
        ours.defects.len()
    ));
    sections(&mut page, ours);
    if plan.ablation {
        ablation::report(&runs, &mut page);
    }
    page.finish()
}

/// Writes the report of a recording that was inspected, into `folder`. Lines before `skip_lines` were trained on. Errors: no
/// labels, no line scores, or nothing in them that can be judged.
pub fn report_recording(
    folder: &Path,
    recording: &Path,
    results: &Path,
    skip_lines: usize,
    made: &Provenance,
) -> Result<PathBuf, ExperimentError> {
    check_folder(folder)?;
    let judged = Judged::read(recording, results, skip_lines)?;
    let mut page = Page::new(folder, TITLE, made, None)?;
    page.paragraph(&format!(
        "Results of {} m of rope in {} views against its labels; the first {} lines, on which the model was trained, do not count. \
         {} defects have a clear label. Lines near a label count neither way.",
        number(Some(judged.metres), 2),
        judged.views,
        skip_lines,
        judged.defects.len()
    ));
    sections(&mut page, &judged);
    page.finish()
}

fn sections(page: &mut Page, judged: &Judged) {
    page.heading("ROC per view and averaged (figure 9)");
    page.paragraph(
        "Share of defect lines against share of intact lines that alarm. Squares mark the paper's 50 % recovery: at least half of \
         every clear label of that view alarms; they are bound to the hardest defect of the view.",
    );
    page.figure("roc", "ROC curves per view and averaged", &figures::roc(judged), 2);
    tables::views(page, judged);
    tables::roc_numbers(page, judged);
    page.heading("What a threshold finds, and what it costs");
    page.paragraph(
        "Over all views; a defect is recovered if half of it alarms in its best view. Rope to look at again: everything within 2.5 cm \
         round a line that alarms in any view, as the paper counts it (103 of 395 m there), true alarms included. This is by single \
         lines; the program reports defects, which are runs of lines merged over views: see below. Filters along the wire, and means of \
         scores that last, reach up to 15 mm beyond a defect and its label's margin is 2 mm, so beside a defect intact lines alarm \
         with it; the closer defects lie, the more of all intact lines those are. *Far false lines* are of intact lines more than \
         5 cm from any label: they compare with a rope on which defects are rare.",
    );
    tables::costs(page, judged);
    tables::decisions(page, judged);
    page.heading("Every defect");
    page.paragraph(
        "False lines that must be tolerated so that half of the defect alarms in its best view: the fewer, the easier.",
    );
    page.figure("defects", "False lines that defects need, by kind and severity", &figures::defects(judged), 2);
    tables::by_kind(page, judged);
    tables::by_severity(page, judged);
    tables::suggestions(page, judged);
    tables::defect_numbers(page, judged);
}
