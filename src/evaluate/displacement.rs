//! Error of the lateral displacement per view: rms about its mean, as only changes are defined. [Wacker13, sec. 6.2]

use super::table::{EvaluateError, Table};
use super::truth::Truth;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Errors of `displacement.csv`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct DisplacementErrors {
    /// True if there is nothing to score.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub missing: bool,
    /// `view{v}_rms_px`, and `view{v}_sign_flipped_rms_px` where the other sign fits better.
    #[serde(flatten)]
    pub rms_px: BTreeMap<String, f64>,
}

/// Running standard deviation.
#[derive(Debug, Clone, Copy, Default)]
struct Spread {
    n: f64,
    mean: f64,
    squares: f64,
}

impl Spread {
    fn add(&mut self, value: f64) {
        self.n += 1.0;
        let off = value - self.mean;
        self.mean += off / self.n;
        self.squares += off * (value - self.mean);
    }

    fn sd(&self) -> f64 {
        (self.squares / self.n).sqrt()
    }
}

/// Scores `RESULTS/displacement.csv`.
pub fn score(truth: Option<&Truth>, results: &Path) -> Result<DisplacementErrors, EvaluateError> {
    let table = Table::open(&results.join("displacement.csv"))?;
    let (Some(truth), Some(mut table)) = (truth, table) else {
        return Ok(DisplacementErrors { missing: true, ..DisplacementErrors::default() });
    };
    let (view, line, displacement) = (table.column("view")?, table.column("line")?, table.column("displacement_px")?);
    let mut spreads = vec![(Spread::default(), Spread::default()); truth.displacement_px.len()];
    while table.next_row()? {
        if table.number(view).is_none() {
            continue;
        }
        let (view, line) = (table.index(view)?, table.index(line)?);
        let Some(Some(true_px)) = truth.displacement_px.get(view) else { continue };
        if let (Some(found_px), Some(&true_px)) = (table.number(displacement), true_px.get(line)) {
            spreads[view].0.add(found_px - f64::from(true_px));
            spreads[view].1.add(-found_px - f64::from(true_px));
        }
    }
    let mut rms_px = BTreeMap::new();
    for (view, (as_is, flipped)) in spreads.iter().enumerate().filter(|(_, s)| s.0.n > 0.0) {
        rms_px.insert(format!("view{view}_rms_px"), as_is.sd());
        if flipped.sd() < as_is.sd() {
            rms_px.insert(format!("view{view}_sign_flipped_rms_px"), flipped.sd());
        }
    }
    Ok(DisplacementErrors { missing: false, rms_px })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_offset_is_no_error_and_a_flipped_sign_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("displacement.csv"), "view,line,displacement_px\n0,0,3\n0,1,2\n0,2,1\n")
            .unwrap();
        let truth =
            |px: [f32; 3]| Truth { phase_rad: vec![0.0; 3], displacement_px: vec![Some(px.to_vec())], wires: None };
        let same = score(Some(&truth([1.0, 0.0, -1.0])), folder.path()).unwrap();
        assert!(same.rms_px["view0_rms_px"] < 1e-9 && same.rms_px.len() == 1);
        let flipped = score(Some(&truth([-1.0, 0.0, 1.0])), folder.path()).unwrap();
        assert!(flipped.rms_px["view0_sign_flipped_rms_px"] < 1e-9);
    }
}
