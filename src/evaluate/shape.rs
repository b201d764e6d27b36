//! True diameter, ovality and looseness of a simulated rope, as its cameras could see them.

use super::table::{EvaluateError, Table};
use super::truth::RecordingFile;
use std::f64::consts::PI;
use std::ops::Range;
use std::path::Path;

/// Angles of views that differ less, in degrees, look in one direction.
const SAME_DIRECTION_DEG: f64 = 10.0;

/// The truth beside a recording; empty where it does not tell.
pub struct Shape {
    diameter_mm: Vec<f64>,
    ovality_percent: Option<f64>,
    angles_deg: Vec<f64>,
    /// Lines with strands, and per strand its deviation in rad there.
    jitter: (Vec<f64>, Vec<Vec<f64>>),
}

impl Shape {
    /// Reads `truth_lines.csv` and `truth_wires.csv`.
    pub fn read(recording: &Path, rope: &RecordingFile) -> Result<Self, EvaluateError> {
        let mut shape = Self {
            diameter_mm: Vec::new(),
            ovality_percent: None,
            angles_deg: rope.angles_deg(),
            jitter: (Vec::new(), vec![Vec::new(); rope.strands]),
        };
        if let Some(mut table) = Table::open(&recording.join("truth_lines.csv"))?
            && let (Some(diameter), Some(ovality)) = (table.find("diameter_mm"), table.find("ovality_percent"))
        {
            while table.next_row()? {
                shape.diameter_mm.push(table.number(diameter).unwrap_or(f64::NAN));
                shape.ovality_percent = table.number(ovality); // the same everywhere
            }
        }
        if let Some(mut table) = Table::open(&recording.join("truth_wires.csv"))? {
            let line = table.column("line")?;
            let jitter: Option<Vec<usize>> =
                (0..rope.strands).map(|j| table.find(&format!("strand_jitter{j}_rad"))).collect();
            let Some(jitter) = jitter else { return Ok(shape) };
            while table.next_row()? {
                shape.jitter.0.push(table.index(line)? as f64);
                for (values, &column) in shape.jitter.1.iter_mut().zip(&jitter) {
                    values.push(table.number(column).unwrap_or(f64::NAN));
                }
            }
        }
        Ok(shape)
    }

    /// Angles of the directions that the views see diameters across, modulo half a turn, in degrees.
    fn directions_deg(&self) -> Vec<f64> {
        let mut directions: Vec<f64> = Vec::new();
        for &angle in &self.angles_deg {
            let apart = |other: &f64| ((angle - other + 90.0).rem_euclid(180.0) - 90.0).abs();
            if directions.iter().all(|other| apart(other) >= SAME_DIRECTION_DEG) {
                directions.push(angle);
            }
        }
        directions
    }

    /// Mean diameter over lines: across a view, or over the directions that the views see.
    pub fn diameter_mm(&self, lines: Range<usize>, view: Option<usize>) -> Option<f64> {
        let ovality = self.ovality_percent? / 100.0;
        let across = |deg: f64| 1.0 + ovality / 2.0 * (deg / 90.0 * PI).cos();
        let directions = self.directions_deg();
        let oval = match view {
            Some(view) => across(*self.angles_deg.get(view)?),
            None if directions.len() > 2 => 1.0, // an oval was put through them
            None => directions.iter().map(|&deg| across(deg)).sum::<f64>() / directions.len() as f64,
        };
        let seen = self.diameter_mm.get(lines)?;
        (!seen.is_empty()).then(|| seen.iter().sum::<f64>() / seen.len() as f64 * oval)
    }

    /// What ovality the views can see: all of it from three directions on, else the difference of two.
    pub fn ovality_percent(&self) -> Option<f64> {
        let ovality = self.ovality_percent?;
        match &self.directions_deg()[..] {
            [a, b] => Some(ovality / 2.0 * ((a / 90.0 * PI).cos() - (b / 90.0 * PI).cos()).abs()),
            [_] | [] => None,
            _ => Some(ovality),
        }
    }

    /// Root mean square of the strands' deviations from their mean over lines.
    pub fn spread_rad(&self, lines: &Range<usize>) -> Option<f64> {
        if self.ovality_percent.is_some_and(|percent| percent > 0.0) {
            return None; // an oval moves strands from their places, too
        }
        let (at, strands) = &self.jitter;
        let from = at.partition_point(|&l| l < lines.start as f64);
        let to = at.partition_point(|&l| l < lines.end as f64);
        let n = strands.len() as f64;
        let mut squares = 0.0;
        for k in from..to {
            let mean = strands.iter().map(|s| s[k]).sum::<f64>() / n;
            squares += strands.iter().map(|s| (s[k] - mean).powi(2)).sum::<f64>() / n;
        }
        (to > from).then(|| (squares / (to - from) as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_see_the_diameter_across_their_direction() {
        let shape = |angles_deg: &[f64]| Shape {
            diameter_mm: vec![32.0; 10],
            ovality_percent: Some(2.0),
            angles_deg: angles_deg.to_vec(),
            jitter: (vec![0.0, 10.0], vec![vec![0.02, 0.02], vec![-0.02, -0.02]]),
        };
        let four = shape(&[0.0, 90.0, 180.0, 270.0]);
        assert!((four.diameter_mm(0..10, Some(0)).unwrap() - 32.32).abs() < 1e-9);
        assert!((four.diameter_mm(0..10, Some(1)).unwrap() - 31.68).abs() < 1e-9);
        assert!((four.diameter_mm(0..10, None).unwrap() - 32.0).abs() < 1e-9);
        assert!((four.ovality_percent().unwrap() - 2.0).abs() < 1e-9);
        assert!((shape(&[0.0, 45.0]).ovality_percent().unwrap() - 1.0).abs() < 1e-9);
        assert!((shape(&[0.0]).diameter_mm(0..10, None).unwrap() - 32.32).abs() < 1e-9);
        assert_eq!(shape(&[0.0]).ovality_percent(), None);
        let round = Shape { ovality_percent: Some(0.0), ..shape(&[0.0]) };
        assert!((round.spread_rad(&(0..10)).unwrap() - 0.02).abs() < 1e-12);
        assert_eq!(four.diameter_mm(0..11, None), None);
    }
}
