//! Finds the straight course of the strands through a stretch by its contours, in the interval that the rope's design allows.

use super::aligner::{AlignerSpec, LEAST_SCORE};
use super::estimates::NotAligned;
use super::measured::Measured;
use super::reference::Reference;
use super::strand_alignment::{StrandAlignment, polish, search};
use super::stretch::ViewModel;

/// How far the lay length may change from one stretch to the next before it is searched anew, as a share.
const RELOCK_TOLERANCE: f64 = 0.06;

/// Aligns the strands of a stretch, starting from the one before if there is one.
pub(super) fn fit_from(
    spec: &AlignerSpec,
    models: &[ViewModel],
    seen: &Measured,
    previous: Option<(usize, &Reference)>,
) -> Result<StrandAlignment, NotAligned> {
    let views: Vec<_> =
        seen.views.iter().zip(models).filter(|(v, _)| v.shows_edges()).map(|(v, m)| v.contour_view(m)).collect();
    if views.is_empty() {
        let lost = seen.views.iter().all(|v| v.lines_seen() == 0);
        return Err(if lost { NotAligned::LinesLost } else { NotAligned::NoRope });
    }
    let step = spec.rope.strand_step_rad();
    let found = match previous {
        Some((first_line, reference)) => {
            let middle = seen.first_line as f64 - first_line as f64 + (seen.lines as f64 - 1.0) / 2.0;
            let rate = reference.rate_rad_per_mm;
            let expected = reference.mean_phase_rad(middle);
            let tracked = polish(&views, spec.pitch_mm, expected, rate).filter(|f| f.score >= LEAST_SCORE);
            let relocked = || {
                let lay = std::f64::consts::TAU / rate;
                search(&views, spec.pitch_mm, (lay * (1.0 - RELOCK_TOLERANCE), lay * (1.0 + RELOCK_TOLERANCE)))
            };
            tracked.or_else(relocked).map(|fit| {
                // Contours repeat from strand to strand: take the repetition nearest to what was expected.
                let turns = ((expected - fit.phase_rad) / step).round();
                StrandAlignment { phase_rad: fit.phase_rad + turns * step, ..fit }
            })
        }
        None => spec
            .searched_strand_lays()
            .into_iter()
            .filter_map(|range| search(&views, spec.pitch_mm, range))
            .max_by(|a, b| a.score.total_cmp(&b.score)),
    };
    match found {
        Some(fit) if fit.score >= LEAST_SCORE => Ok(fit),
        Some(fit) => Err(NotAligned::ContoursDisagree { score: fit.score }),
        None => Err(NotAligned::NoRope),
    }
}

/// Strand lays to search when none is given, in rope diameters.
const SEARCHED_LAY_DIAMETERS: (f64, f64) = (5.0, 9.0);
/// How far a strand lay may be off its nominal value, as a share.
const NOMINAL_TOLERANCE: f64 = 0.12;

impl AlignerSpec {
    /// The same, for a rope of this strand lay. `None` if no such rope can exist.
    pub(super) fn with_strand_lay(&self, lay_mm: f64) -> Option<Self> {
        let design = super::rope::RopeDesign { strand_lay_mm: Some(lay_mm), ..self.rope.design().clone() };
        Some(Self { rope: design.validate().ok()?, ..self.clone() })
    }

    /// Signed intervals of the strand lay in mm that are searched: about the nominal value, or wide where none is given.
    ///
    /// Without a nominal value only right-hand lays are searched: contours of one view do not tell the hand, the slant of the
    /// strands in the image does, afterwards.
    pub(super) fn searched_strand_lays(&self) -> Vec<(f64, f64)> {
        match self.rope.design().strand_lay_mm {
            Some(lay) => vec![(lay * (1.0 - NOMINAL_TOLERANCE), lay * (1.0 + NOMINAL_TOLERANCE))],
            None => {
                let range = (
                    SEARCHED_LAY_DIAMETERS.0 * self.rope.diameter_mm(),
                    SEARCHED_LAY_DIAMETERS.1 * self.rope.diameter_mm(),
                );
                if self.view_angles_rad.len() > 1 { vec![range, (-range.1, -range.0)] } else { vec![range] }
            }
        }
    }
}
