//! What an inspection says in the end: a page for people, one JSON object for scripts.

use super::results_out::RESULTS;
use anyhow::Context;
use ropescope::pipeline::Acquisition;
use ropescope::pipeline::diameters::Place;
use ropescope::pipeline::results::{DefectRow, Kind, LayLengthRow, Summary};
use ropescope::workers::results_folder;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Defects that are listed; more are counted.
const MOST_DEFECTS: usize = 20;
/// Gaps in the coverage that are listed; more are summed up.
const MOST_GAPS: usize = 8;

/// Mean of a lay length over the rope.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct MeanLay {
    nominal_mm: Option<f64>,
    /// `None` without estimates.
    mean_mm: Option<f64>,
    /// Spread along the rope; `None` with fewer than two estimates.
    sd_mm: Option<f64>,
    estimates: usize,
    /// Estimates there would be if nothing were missing.
    of: usize,
}

impl MeanLay {
    fn of<'a>(nominal_mm: Option<f64>, values: impl Iterator<Item = Option<f64>> + 'a) -> Self {
        let all: Vec<Option<f64>> = values.collect();
        let known: Vec<f64> = all.iter().copied().flatten().collect();
        let n = known.len() as f64;
        let mean_mm = (!known.is_empty()).then(|| known.iter().sum::<f64>() / n);
        let squares = |mean: f64| known.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
        let sd_mm = mean_mm.filter(|_| known.len() > 1).map(|mean| (squares(mean) / (n - 1.0)).sqrt());
        Self { nominal_mm, mean_mm, sd_mm, estimates: known.len(), of: all.len() }
    }
}

impl fmt::Display for MeanLay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.mean_mm {
            None => write!(f, "not measured anywhere")?,
            Some(mean) => write!(f, "{mean:.2} mm")?,
        }
        if let Some(sd) = self.sd_mm {
            write!(f, ", sd {sd:.2} mm")?;
        }
        write!(f, " ({} of {} estimates", self.estimates, self.of)?;
        match self.nominal_mm {
            Some(nominal) => write!(f, "; nominal {nominal:.2} mm)"),
            None => write!(f, ")"),
        }
    }
}

/// What an inspection concluded.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    event: &'static str,
    results: PathBuf,
    summary: Summary,
    strand_lay: MeanLay,
    wire_lay: MeanLay,
    /// Strand by strand.
    wire_lays: Vec<MeanLay>,
    /// `None` without a model.
    defects: Option<Vec<DefectRow>>,
    /// Places under the threshold that are worth looking at again; `None` without a second level.
    look_again: Option<Vec<DefectRow>>,
    files: Vec<PathBuf>,
}

impl Report {
    /// Reads back what was written.
    pub(crate) fn gather(folder: &Path, acquisition: &Acquisition, summary: Summary) -> anyhow::Result<Self> {
        let rows = results_folder::lay_lengths(folder).context("the results cannot be read back")?;
        let fused: Vec<&LayLengthRow> = rows.iter().filter(|row| row.view.is_none()).collect();
        let design = acquisition.rope.design();
        let wire = |j: usize| fused.iter().map(move |row| row.wires.get(j).and_then(|w| w.lay_mm));
        let strands = acquisition.rope.strands();
        Ok(Self {
            event: "done",
            results: folder.into(),
            strand_lay: MeanLay::of(design.strand_lay_mm, fused.iter().map(|row| row.strand_lay_mm)),
            wire_lay: MeanLay::of(design.wire_lay_mm, (0..strands).flat_map(wire)),
            wire_lays: (0..strands).map(|j| MeanLay::of(design.wire_lay_mm, wire(j))).collect(),
            defects: match summary.defects {
                Some(_) => Some(results_folder::defects(folder).context("the results cannot be read back")?),
                None => None,
            },
            look_again: match summary.look_again {
                Some(_) => Some(results_folder::look_again(folder).context("the results cannot be read back")?),
                None => None,
            },
            files: RESULTS.iter().map(|name| folder.join(name)).filter(|path| path.exists()).collect(),
            summary,
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = &self.summary;
        writeln!(
            f,
            "inspected   {}: {:.2} m in {:.1} s ({:.2} m/s)",
            s.construction, s.metres, s.seconds, s.metres_per_second
        )?;
        writeln!(f, "strand lay  {}", self.strand_lay)?;
        writeln!(f, "wire lay    {}", self.wire_lay)?;
        for (j, lay) in self.wire_lays.iter().enumerate() {
            if let (Some(mean), Some(sd)) = (lay.mean_mm, lay.sd_mm) {
                writeln!(f, "  strand {j}  {mean:.2} mm, sd {sd:.2} mm")?;
            }
        }
        if let Some(diameter) = &s.diameter {
            let (smallest, largest) = (diameter.smallest_mm, diameter.largest_mm);
            write!(f, "diameter    {:.2} mm", diameter.mean_mm)?;
            // A single stretch has no other to differ from.
            if smallest.position_m != largest.position_m {
                let place = |p: Place| format!("{:.2} at {:.2} m", p.value, p.position_m);
                write!(f, " ({} to {})", place(smallest), place(largest))?;
            }
            writeln!(f, "{}", if diameter.absolute { "" } else { ", relative to the nominal one" })?;
            if let Some(oval) = &diameter.ovality_percent {
                let (value, sd, position_m) = (oval.value, oval.sd, oval.position_m);
                writeln!(f, "  ovality   up to {value:.2} %, sd {sd:.2} % (at {position_m:.2} m)")?;
            }
            if let Some(loose) = &diameter.strand_spread_rad {
                let (value, sd, position_m) = (loose.value, loose.sd, loose.position_m);
                writeln!(f, "  looseness up to {value:.4} rad, sd {sd:.4} rad (at {position_m:.2} m)")?;
            }
        }
        if let Some(threshold) = &s.threshold {
            writeln!(f, "threshold   line score {:.3}: {}", threshold.line_score, threshold.origin)?;
        }
        if let Some(fit) = &s.fit {
            let verdict = match (fit.fits, fit.cannot_tell()) {
                (false, _) => "retrain",
                (true, true) => "too little rope to tell whether it fits",
                (true, false) => "it fits",
            };
            match (fit.false_defects_per_100m, fit.at_least_per_100m, fit.at_most_per_100m) {
                (Some(rate), Some(low), Some(high)) => writeln!(
                    f,
                    "model fit   about {rate:.1} false defects per 100 m of this rope ({low:.1} to {high:.1} with 95 %), made for {}: {verdict}",
                    fit.budget_per_100m,
                )?,
                _ => writeln!(f, "model fit   {:.2} m without alarms: {verdict}", fit.metres)?,
            }
        }
        self.write_defects(f)?;
        self.write_gaps(f)?;
        for note in &s.notes {
            writeln!(f, "note        {note}")?;
        }
        let names: Vec<_> =
            self.files.iter().filter_map(|path| path.file_name()).map(|n| n.to_string_lossy()).collect();
        writeln!(f, "results     {}: {}", self.results.display(), names.join(", "))
    }
}

impl Report {
    fn write_defects(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(defects) = &self.defects else {
            return writeln!(f, "defects     not looked for: that needs --model");
        };
        writeln!(f, "defects     {}", defects.len())?;
        write_places(f, defects, "defects.json")?;
        if let (Some(places), Some(level)) =
            (&self.look_again, self.summary.threshold.as_ref().and_then(|t| t.look_again_line_score))
        {
            writeln!(f, "look again  {}, over line score {level:.3} but not over the threshold", places.len())?;
            write_places(f, places, "look_again.json")?;
        }
        Ok(())
    }

    fn write_gaps(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gaps = &self.summary.not_covered;
        let length =
            |gaps: &[ropescope::pipeline::results::NotCovered]| gaps.iter().fold(0.0, |sum, g| sum + g.to_m - g.from_m);
        let total_m = self.summary.covered_view_m + length(gaps);
        writeln!(f, "not covered {:.2} of {total_m:.2} m, summed over the views", length(gaps))?;
        for gap in gaps.iter().take(MOST_GAPS) {
            writeln!(f, "  view {}    metre {:.3} to {:.3}: {}", gap.view, gap.from_m, gap.to_m, gap.reason)?;
        }
        if gaps.len() > MOST_GAPS {
            writeln!(f, "  and {:.2} m more in summary.json", length(&gaps[MOST_GAPS..]))?;
        }
        Ok(())
    }
}

fn write_places(f: &mut fmt::Formatter<'_>, defects: &[DefectRow], file: &str) -> fmt::Result {
    for d in defects.iter().take(MOST_DEFECTS) {
        let part = |name: &str, number: Option<usize>| number.map_or_else(String::new, |n| format!(", {name} {n}"));
        let mut views: Vec<usize> = d.alarms.iter().map(|a| a.view).collect();
        views.sort_unstable();
        views.dedup();
        let views: Vec<String> = views.iter().map(usize::to_string).collect();
        writeln!(
            f,
            "  {:>4}      metre {:.3} to {:.3}{}{}, seen by {} {}; score {:.2}{}",
            d.id,
            d.from_m,
            d.to_m,
            part("strand", d.strand),
            part("wire", d.wire),
            if views.len() == 1 { "view" } else { "views" },
            views.join(", "),
            d.peak_score,
            d.suggestion.as_ref().map_or_else(String::new, |s| format!(", {}: {}", kind_in_words(s.kind), s.why))
        )?;
    }
    if defects.len() > MOST_DEFECTS {
        writeln!(f, "  and {} more in {file}", defects.len() - MOST_DEFECTS)?;
    }
    Ok(())
}

fn kind_in_words(kind: Kind) -> &'static str {
    match kind {
        Kind::Gap => "likely a gap",
        Kind::MissingWire => "likely a missing wire",
        Kind::ProtrudingWire => "likely a protruding wire",
        Kind::SurfaceChange => "likely a changed surface",
        Kind::Unclear => "kind unclear",
    }
}
