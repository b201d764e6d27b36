//! `evaluate alignment`: how exact lay lengths are, beside what the images know at all. [Wacker13, sec. 6.3]

mod bounds; // Cramer-Rao, for every setting its own
mod deformation; // known deformations recovered
mod lost; // random ropes at high noise
mod noise; // figure 6a, b
mod plan; // how much rope
mod progression; // figure 6c, d
mod short_rope; // figure 7, and repeatability

pub use plan::Plan;

use super::page::{Page, check_folder};
use super::work::Work;
use super::{ExperimentError, Provenance};
use crate::pipeline::Progress;
use std::path::{Path, PathBuf};

/// Name of the work in progress reports.
pub const STAGE: &str = "alignment";

/// Runs all experiments and writes the report into `folder`; answers its page.
pub fn report(
    folder: &Path,
    plan: &Plan,
    made: &Provenance,
    progress: &dyn Progress,
) -> Result<PathBuf, ExperimentError> {
    check_folder(folder)?;
    let work = Work::new(progress, STAGE, plan.total_m());
    let mut page = Page::new(folder, "How exact lay lengths are", made, Some(plan.seed))?;
    page.paragraph(
        "The experiments of Wacker & Denzler (section 6.3) on simulated rope with known truth, inspected as `ropescope inspect` does; \
         fused estimates of stretches of 0.2 m. Errors are |estimate| less |truth|, the truth being the regression slope of the true \
         phase over the stretch.",
    );
    noise::report(plan, &work, &mut page)?;
    progression::report(plan, &work, &mut page)?;
    short_rope::report(plan, &work, &mut page)?;
    short_rope::repeatability(plan, &work, &mut page)?;
    deformation::report(plan, &work, &mut page)?;
    lost::report(plan, &work, &mut page)?;
    page.finish()
}
