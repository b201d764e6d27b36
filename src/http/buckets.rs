//! Lay lengths and diameters in buckets of rope: least, mean and greatest, or null with a reason.

use super::tables::cell;
use crate::store::lay_lengths::Stretch;
use serde::Serialize;
use utoipa::ToSchema;

/// Most buckets of a request.
pub const MAX_BUCKETS: u32 = 5000;

/// Least, mean and greatest value of a bucket.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Range {
    /// Least (lay lengths are signed: the most negative).
    pub min: f64,
    /// Mean of the stretches that touch the bucket.
    pub mean: f64,
    /// Greatest.
    pub max: f64,
}

/// A bucket of rope.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Bucket {
    /// Rope metre where it begins.
    pub from_m: f64,
    /// Rope metre where it ends.
    pub to_m: f64,
    /// Stretches that touch it.
    pub count: usize,
    /// Strand lay in mm; null if no stretch has one.
    #[schema(required)]
    pub strand_lay_mm: Option<Range>,
    /// Wire lay in mm of each strand; null if no stretch has one.
    pub wire_lay_mm: Vec<Option<Range>>,
    /// Rope diameter in mm; null if no stretch has one.
    #[schema(required)]
    pub diameter_mm: Option<Range>,
    /// Why something is null; null if nothing is.
    #[schema(required)]
    pub reason: Option<String>,
}

#[derive(Clone, Default)]
struct Sum {
    count: usize,
    sum: f64,
    range: Option<(f64, f64)>,
}

impl Sum {
    fn add(&mut self, value: Option<f64>) {
        let Some(value) = value else { return };
        self.count += 1;
        self.sum += value;
        self.range = Some(self.range.map_or((value, value), |(min, max)| (min.min(value), max.max(value))));
    }

    fn range(&self) -> Option<Range> {
        self.range.map(|(min, max)| Range { min, mean: self.sum / self.count as f64, max })
    }
}

/// Divides `[from_m, to_m]` into `n` buckets of equal length. A stretch counts in every bucket that it touches: buckets finer
/// than stretches must not look like gaps.
pub fn buckets(stretches: &[Stretch], from_m: f64, to_m: f64, n: u32, strands: usize) -> Vec<Bucket> {
    let n = n as usize;
    let length_m = (to_m - from_m) / n as f64;
    let edge = |i: usize| if i == n { to_m } else { from_m + i as f64 * length_m };
    let mut sums = vec![(0_usize, [Sum::default(), Sum::default()], vec![Sum::default(); strands], None::<&str>); n];
    for stretch in stretches {
        if stretch.to_m < from_m || stretch.from_m > to_m {
            continue;
        }
        // The casts saturate at 0; an end exactly on an edge does not touch the bucket after it.
        let first = (((stretch.from_m - from_m) / length_m) as usize).min(n - 1);
        let last = ((((stretch.to_m - from_m) / length_m).ceil() - 1.0) as usize).clamp(first, n - 1);
        for (count, [strand, diameter], wires, reason) in &mut sums[first..=last] {
            *count += 1;
            strand.add(stretch.row.strand_lay_mm);
            diameter.add(stretch.row.diameter_mm);
            for (sum, wire) in wires.iter_mut().zip(&stretch.row.wires) {
                sum.add(wire.lay_mm);
            }
            if reason.is_none() {
                *reason = stretch.row.reason.as_deref();
            }
        }
    }
    sums.into_iter()
        .enumerate()
        .map(|(i, (count, [strand, diameter], wires, reason))| {
            let (strand_lay_mm, diameter_mm) = (strand.range(), diameter.range());
            let wire_lay_mm: Vec<_> = wires.iter().map(Sum::range).collect();
            let whole = strand_lay_mm.is_some() && diameter_mm.is_some() && wire_lay_mm.iter().all(Option::is_some);
            let reason = match (whole, count, reason) {
                (true, ..) => None,
                (false, 0, _) => Some("this part of the rope was not inspected".to_owned()),
                (false, _, Some(reason)) => Some(reason.to_owned()),
                (false, _, None) => Some("no estimate could be made".to_owned()),
            };
            Bucket { from_m: edge(i), to_m: edge(i + 1), count, strand_lay_mm, wire_lay_mm, diameter_mm, reason }
        })
        .collect()
}

/// Names of the CSV columns of a bucket of a rope of so many strands.
pub fn columns(strands: usize) -> Vec<String> {
    let mut names: Vec<String> = ["from_m", "to_m", "count"].map(str::to_owned).into();
    let kinds = std::iter::once("strand_lay".to_owned()).chain((0..strands).map(|j| format!("wire_lay_{j}")));
    let kinds = kinds.chain(["diameter".to_owned()]);
    names.extend(kinds.flat_map(|kind| ["min", "mean", "max"].map(|what| format!("{kind}_{what}_mm"))));
    names.push("reason".to_owned());
    names
}

/// The cells of a bucket, in the order of [`columns`].
pub fn cells(bucket: &Bucket) -> Vec<String> {
    let mut cells = vec![bucket.from_m.to_string(), bucket.to_m.to_string(), bucket.count.to_string()];
    for range in std::iter::once(&bucket.strand_lay_mm).chain(&bucket.wire_lay_mm).chain([&bucket.diameter_mm]) {
        cells.extend([range.map(|r| r.min), range.map(|r| r.mean), range.map(|r| r.max)].map(cell));
    }
    cells.push(cell(bucket.reason.as_ref()));
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::results::{LayLengthRow, WireEstimate};

    fn stretch(from_m: f64, to_m: f64, lay: Option<f64>) -> Stretch {
        let row = LayLengthRow {
            position_m: (from_m + to_m) / 2.0,
            strand_lay_mm: lay,
            diameter_mm: lay.map(|l| l / 7.0),
            wires: vec![WireEstimate { lay_mm: lay.map(|l| -l), ..WireEstimate::default() }],
            reason: lay.is_none().then(|| "too dark".to_owned()),
            ..LayLengthRow::default()
        };
        Stretch { from_m, to_m, row }
    }

    #[test]
    fn buckets_hold_least_mean_and_greatest_and_gaps_have_reasons() {
        let stretches = [stretch(0.0, 1.0, Some(100.0)), stretch(1.0, 2.0, Some(104.0)), stretch(2.0, 4.0, None)];
        let found = buckets(&stretches, 0.0, 6.0, 3, 1);
        assert_eq!(found[0].strand_lay_mm, Some(Range { min: 100.0, mean: 102.0, max: 104.0 }));
        assert_eq!(found[0].wire_lay_mm[0].unwrap().min, -104.0);
        assert_eq!(found[0].diameter_mm.unwrap().max, 104.0 / 7.0);
        assert_eq!(columns(1).len(), cells(&found[0]).len());
        assert_eq!((found[0].count, found[0].reason.as_deref()), (2, None));
        assert_eq!((found[1].strand_lay_mm, found[1].reason.as_deref()), (None, Some("too dark")));
        assert_eq!(found[2].reason.as_deref(), Some("this part of the rope was not inspected"));
    }

    #[test]
    fn buckets_finer_than_stretches_have_no_gaps() {
        let found = buckets(&[stretch(0.0, 1.0, Some(100.0))], 0.0, 1.0, 7, 1);
        assert!(found.iter().all(|b| b.count == 1));
        assert_eq!(found[6].to_m, 1.0);
    }
}
