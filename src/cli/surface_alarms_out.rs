//! Surface alarms per window of rope in the results folder, as the API counts them for a rope without windows of its own.

use anyhow::Context;
use ropescope::pipeline::Acquisition;
use ropescope::pipeline::results::{DefectRow, LayLengthRow, Summary};
use ropescope::pipeline::surface_alarms::{SurfaceAlarms, UnitLengths, usual, write_csv};
use ropescope::pipeline::windows::Span;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Writes `surface_alarms.csv` into a results folder.
pub(crate) fn write(
    results: &Path,
    acquisition: &Acquisition,
    summary: &Summary,
    lay_lengths: &[LayLengthRow],
    defects: &[DefectRow],
) -> anyhow::Result<()> {
    let rope = Span { from_m: acquisition.start_m, to_m: acquisition.start_m + summary.metres };
    let fused = lay_lengths.iter().filter(|row| row.view.is_none());
    let lays_mm = fused.filter_map(|row| row.strand_lay_mm);
    let design = acquisition.rope.design();
    let lengths = UnitLengths::new(acquisition.rope.diameter_mm(), design.strand_lay_mm, lays_mm);
    let places: Vec<Span> = defects.iter().map(|d| Span { from_m: d.from_m, to_m: d.to_m }).collect();
    let alarms = SurfaceAlarms::new(rope, lengths, &places, &summary.not_covered);
    let windows: Vec<_> = usual().into_iter().map(|window| alarms.over(window)).collect();
    let path = results.join("surface_alarms.csv");
    let written =
        File::create(&path).map_err(csv::Error::from).and_then(|file| write_csv(&windows, BufWriter::new(file)));
    written.with_context(|| format!("cannot write {}", path.display()))
}
