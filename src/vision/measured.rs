//! What the aligner holds of the rope: a stretch with all that was measured in it, and the views with all that was learnt of them.

use super::agreement::Agreement;
use super::aligner_spec::AlignerSpec;
use super::encoder::EncoderEvidence;
use super::estimates::NotAligned;
use super::outline_detail::DetailSums;
use super::reference::Reference;
use super::shared_axis::SharedAxis;
use super::strand_alignment::StrandAlignment;
use super::stretch::{StrandKnots, ViewModel, ViewStretch};
use super::template::TemplateSums;
use super::unwrapping::{StripeTable, Stripes};
use super::width::{WidthAgreement, WidthScatter};
use super::wire_pattern::PatternSums;
use super::wire_tracking::{Grid, StripeShift, WireKnot};

/// A stretch with everything measured in it.
#[derive(Debug)]
pub(super) struct Measured {
    /// Whether its contours were measured elsewhere.
    pub given: bool,
    pub first_line: usize,
    pub lines: usize,
    pub views: Vec<ViewStretch>,
    pub fit: Result<StrandAlignment, NotAligned>,
    /// What was measured with this fit.
    pub reference: Option<Reference>,
    pub strands: StrandKnots,
    pub stripes: Vec<Stripes>,
    /// `wires[v][j]`: measured wires per knot.
    pub wires: Vec<Vec<Vec<WireKnot>>>,
}

impl Measured {
    /// Takes another fit, with which nothing was measured yet.
    pub fn refit(&mut self, fit: Result<StrandAlignment, NotAligned>) {
        (self.fit, self.reference) = (fit, None);
    }

    pub fn knots(&self, spec: &AlignerSpec) -> usize {
        self.lines.div_ceil(spec.knot_lines)
    }

    pub fn grid(&self, spec: &AlignerSpec) -> Grid {
        Grid {
            first_mm: self.first_line as f64 * spec.pitch_mm,
            pitch_mm: spec.pitch_mm,
            reading_lines: spec.reading_lines,
            knot_lines: spec.knot_lines,
            knots: self.knots(spec),
        }
    }
}

/// Everything that was learnt of the views by the lock, and refined while tracking.
#[derive(Debug)]
pub(super) struct Views {
    pub models: Vec<ViewModel>,
    pub sums: Vec<TemplateSums>,
    pub pattern_sums: Vec<PatternSums>,
    pub detail_sums: Vec<DetailSums>,
    pub shifts: Vec<StripeShift>,
    pub wire_noise_scale: f64,
    pub shared_axis: SharedAxis,
    pub encoder: EncoderEvidence,
    pub agreement: Agreement,
    pub table: StripeTable,
    /// Mean column of each view's axis where the rope was found: there its scale was fitted.
    pub found_axis_px: Vec<f64>,
    pub widths: Vec<WidthScatter>,
    pub width_agreement: WidthAgreement,
}
