//! What a recording knows of itself: phases and lateral positions per line, wires every few lines.

use super::table::{EvaluateError, Table};
use serde::Deserialize;
use std::f64::consts::TAU;
use std::path::Path;

/// The part of `rope.json` that scoring needs.
#[derive(Debug, Clone, Deserialize)]
pub struct RecordingFile {
    /// Number of strands.
    pub strands: usize,
    /// Outer wires of a strand.
    #[serde(default)]
    pub wires_per_strand: Option<usize>,
    /// Rope per line in mm.
    pub line_pitch_mm: f64,
    /// Lines of a view; absent in recordings without truth.
    pub lines: Option<usize>,
    /// The views.
    pub views: Vec<serde_json::Value>,
}

impl RecordingFile {
    /// Reads `DIR/rope.json`.
    pub fn read(folder: &Path) -> Result<Self, EvaluateError> {
        read_json(&folder.join("rope.json"))
    }

    /// Angles of the views in degrees.
    pub fn angles_deg(&self) -> Vec<f64> {
        self.views.iter().map(|view| view["angle_deg"].as_f64().unwrap_or(0.0)).collect()
    }

    /// Whether the views state their scale, so that diameters are absolute.
    pub fn is_calibrated(&self) -> bool {
        self.views.iter().all(|view| view["px_per_mm"].is_number())
    }
}

/// Reads a JSON file.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, EvaluateError> {
    let file = std::fs::File::open(path).map_err(|source| EvaluateError::Read { path: path.into(), source })?;
    serde_json::from_reader(std::io::BufReader::new(file))
        .map_err(|e| EvaluateError::Json { path: path.into(), reason: e.to_string() })
}

/// True wires of one strand at the lines of [`TrueWires::lines`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrueWires {
    /// Lines at which phases are known, ascending.
    pub lines: Vec<f64>,
    /// Per strand: phase of wire 0 in rad at those lines.
    pub phase_rad: Vec<Vec<f64>>,
    /// Mean over the strands of their own phase deviation in rad at those lines; empty if not recorded.
    pub mean_jitter_rad: Vec<f64>,
}

/// `truth_lines.csv` and `truth_wires.csv`.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Phase of the rope per line in rad: of strand 0, plus the strands' mean deviation.
    pub phase_rad: Vec<f64>,
    /// Per view: column of the rope axis less its mean, per line in px; `None` if not recorded.
    pub displacement_px: Vec<Option<Vec<f32>>>,
    /// Wires, if recorded.
    pub wires: Option<TrueWires>,
}

/// Views whose displacement may be recorded.
const MAX_VIEWS: usize = 8;

impl Truth {
    /// Reads the truth beside a recording; `None` if it has none.
    pub fn read(folder: &Path, strands: usize) -> Result<Option<Self>, EvaluateError> {
        let Some(mut table) = Table::open(&folder.join("truth_lines.csv"))? else { return Ok(None) };
        let phase = table.column("strand_phase_rad")?;
        let columns: Vec<_> = (0..MAX_VIEWS).map(|v| table.find(&format!("dv{v}_px"))).collect();
        let mut phase_rad = Vec::new();
        let mut displacement_px: Vec<_> = columns.iter().map(|c| c.map(|_| Vec::new())).collect();
        while table.next_row()? {
            phase_rad.push(table.number(phase).unwrap_or(f64::NAN));
            for (column, values) in columns.iter().zip(&mut displacement_px) {
                if let (Some(column), Some(values)) = (column, values) {
                    values.push(table.number(*column).unwrap_or(f64::NAN) as f32);
                }
            }
        }
        let wires = read_wires(folder, strands)?;
        if let Some(wires) = &wires {
            add_interpolated(&mut phase_rad, &wires.lines, &wires.mean_jitter_rad);
        }
        Ok(Some(Self { phase_rad, displacement_px, wires }))
    }
}

fn read_wires(folder: &Path, strands: usize) -> Result<Option<TrueWires>, EvaluateError> {
    let Some(mut table) = Table::open(&folder.join("truth_wires.csv"))? else { return Ok(None) };
    let line = table.column("line")?;
    let phases = (0..strands).map(|j| table.column(&format!("wire_phase{j}_rad"))).collect::<Result<Vec<_>, _>>()?;
    let jitters: Option<Vec<_>> = (0..strands).map(|j| table.find(&format!("strand_jitter{j}_rad"))).collect();
    let mut wires = TrueWires { phase_rad: vec![Vec::new(); strands], ..TrueWires::default() };
    while table.next_row()? {
        wires.lines.push(table.index(line)? as f64);
        for (values, &column) in wires.phase_rad.iter_mut().zip(&phases) {
            values.push(table.number(column).unwrap_or(f64::NAN));
        }
        if let Some(jitters) = &jitters {
            let sum: f64 = jitters.iter().filter_map(|&c| table.number(c)).sum();
            wires.mean_jitter_rad.push(sum / strands as f64);
        }
    }
    Ok(Some(wires))
}

/// Adds values known at some lines to a value per line, interpolated, constant beyond the ends.
fn add_interpolated(per_line: &mut [f64], lines: &[f64], values: &[f64]) {
    if lines.is_empty() || values.len() != lines.len() {
        return;
    }
    let mut next = 0;
    for (line, value) in per_line.iter_mut().enumerate() {
        let at = line as f64;
        while next < lines.len() && lines[next] <= at {
            next += 1;
        }
        *value += match next {
            0 => values[0],
            n if n == lines.len() => values[n - 1],
            n => {
                let t = (at - lines[n - 1]) / (lines[n] - lines[n - 1]);
                values[n - 1] + t * (values[n] - values[n - 1])
            }
        };
    }
}

/// Lay length of a stretch in mm: 2 pi over the regression slope of the phase against the line counter.
///
/// `None` with fewer than two points. What the encoder got wrong is nobody's to know, so x is the counter.
pub fn regression_lay_mm(points: impl Iterator<Item = (f64, f64)> + Clone) -> Option<f64> {
    let (n, sum_x, sum_phase) = points.clone().fold((0.0, 0.0, 0.0), |s, (x, p)| (s.0 + 1.0, s.1 + x, s.2 + p));
    if n < 2.0 {
        return None;
    }
    let (mean_x, mean_phase) = (sum_x / n, sum_phase / n);
    let (xx, xp) =
        points.fold((0.0, 0.0), |s, (x, p)| (s.0 + (x - mean_x).powi(2), s.1 + (x - mean_x) * (p - mean_phase)));
    Some(TAU * xx / xp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lay_of_a_straight_phase_is_its_lay() {
        let lay = regression_lay_mm((0..500).map(|k| (f64::from(k) * 0.1, 0.4 - f64::from(k) * 0.1 * TAU / 220.0)));
        assert!((lay.unwrap() + 220.0).abs() < 1e-9);
        assert_eq!(regression_lay_mm(std::iter::once((0.0, 1.0))), None);
    }

    #[test]
    fn interpolation_is_constant_beyond_its_ends() {
        let mut values = vec![0.0; 6];
        add_interpolated(&mut values, &[1.0, 3.0], &[10.0, 20.0]);
        assert_eq!(values, [10.0, 10.0, 15.0, 20.0, 20.0, 20.0]);
    }
}
