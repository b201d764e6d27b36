//! What single columns of a sensor do to the gray: dead or stuck ones, tired or hot ones, and dust on the glass a few columns wide.
//!
//! Strands and wires pass every column alike, so over some lays of rope a column's mean is like that of its neighbours. Where a few
//! columns are off, in one half of the rope as in the other, the sensor is at fault and not the rope: their gray is set right, or,
//! where they tell nothing, drawn between the neighbours' and not judged. What is broader is left as it is: the appearance is learnt by
//! place in view, and gray is judged beside what is about it. Streaks of dirt run along a rope, too, and look alike as long as they
//! are faint, so only what is strong counts.

use super::image::GrayImage;
use super::lost_lines::LostLines;
use std::ops::Range;

/// Columns to either side that a column is compared with; what is as wide as that is not the sensor's.
const BESIDE: usize = 8;
/// Every so many lines are read.
const EVERY_LINES: usize = 8;
/// Lines read after which what was read before counts half: dust comes and goes. Of 0.1 mm each, 6.4 m of rope.
const REMEMBERED: f64 = 8000.0;
/// Columns whose neighbours have less mean gray than this share of the brighter ones are the rope's edge and the background.
const LIT: f32 = 0.4;
/// Fewest gray values of light that tell a gain.
const LEAST_GRAY: f32 = 12.0;
/// How far a column's mean must be off its neighbours', as a share, to be set right, where it stays so, and how far those beside it.
const OFF: f32 = 0.15;
const STILL_OFF: f32 = 0.1;
const OFF_BESIDE: f32 = 0.03;
/// The same for one or two columns, which are narrower than anything on a rope.
const OFF_ALONE: f32 = 0.08;
/// Both halves of the rope must say at least this share of what the other one says.
const AGREED: f32 = 0.6;
/// A column that varies less than this share of what its neighbours do is stuck, if those vary by so many gray values.
const STUCK: f32 = 0.15;
const LEAST_VARIED: f32 = 3.0;
/// A column with less light than this share of its neighbours tells too little.
const BLIND: f32 = 0.3;
/// Columns beside a stuck one that are not judged: what is compared with it is made up.
const NOT_JUDGED_BESIDE: usize = 2;

/// Sums over the lines of every column.
#[derive(Debug, Clone, Default)]
struct ColumnSums {
    lines: f64,
    /// Sum and sum of squares.
    sums: Vec<(f64, f64)>,
}

impl ColumnSums {
    fn add(&mut self, row: &[u8]) {
        self.lines += 1.0;
        for ((sum, squares), &gray) in self.sums.iter_mut().zip(row) {
            let gray = f64::from(gray);
            *sum += gray;
            *squares += gray * gray;
        }
    }

    fn fade(&mut self) {
        self.lines *= 0.5;
        self.sums.iter_mut().for_each(|(sum, squares)| (*sum, *squares) = (0.5 * *sum, 0.5 * *squares));
    }

    /// Mean and standard deviation of every column.
    fn moments(sums: &[&Self]) -> (Vec<f32>, Vec<f32>) {
        let lines: f64 = sums.iter().map(|sums| sums.lines).sum();
        let columns = sums.first().map_or(0, |sums| sums.sums.len());
        let of_column = |column: usize| {
            let add = |(a, b): (f64, f64), sums: &&Self| (a + sums.sums[column].0, b + sums.sums[column].1);
            let (sum, squares) = sums.iter().fold((0.0, 0.0), add);
            let mean = sum / lines;
            (mean as f32, (squares / lines - mean * mean).max(0.0).sqrt() as f32)
        };
        (0..columns).map(of_column).unzip()
    }
}

/// What a column does to the gray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Fault {
    #[default]
    None,
    /// Gray is that many times what it should be.
    Gain(f32),
    /// Gray is that much more than it should be.
    Offset(f32),
    /// Gray says nothing.
    Stuck,
}

/// Learns the columns of one view's sensor, stretch after stretch, and sets them right.
#[derive(Debug, Clone, Default)]
pub struct Columns {
    /// Of every other stretch each.
    halves: [ColumnSums; 2],
    stretches: usize,
    faults: Vec<Fault>,
}

/// Median of the columns within [`BESIDE`]: along a slope it is the column's own value.
fn medians(values: &[f32]) -> Vec<f32> {
    let mut near = Vec::with_capacity(2 * BESIDE + 1);
    let last = values.len() as isize - 1;
    (0..values.len() as isize)
        .map(|column| {
            let reach = (BESIDE as isize).min(column).min(last - column);
            near.clear();
            near.extend_from_slice(&values[(column - reach) as usize..=(column + reach) as usize]);
            *near.select_nth_unstable_by(reach as usize, f32::total_cmp).1
        })
        .collect()
}

impl Columns {
    /// Reads a stretch as the sensor gave it.
    pub fn read(&mut self, image: &GrayImage, lost: &LostLines) {
        let half = &mut self.halves[self.stretches % 2];
        self.stretches += 1;
        half.sums.resize(image.width(), (0.0, 0.0));
        for line in (0..image.lines()).step_by(EVERY_LINES).filter(|&line| !lost.contains(line)) {
            half.add(image.line(line));
        }
        if self.halves.iter().map(|half| half.lines).sum::<f64>() > REMEMBERED {
            self.halves.iter_mut().for_each(ColumnSums::fade);
        }
    }

    /// Learns what is wrong from all that was read, if it was at least so many lines; less shows single wires.
    pub fn learn(&mut self, least_lines: usize) {
        let [one, other] = &self.halves;
        if one.lines.min(other.lines) * 2.0 * (EVERY_LINES as f64) < least_lines as f64
            || one.sums.len() != other.sums.len()
        {
            return;
        }
        let (means, varied) = ColumnSums::moments(&[one, other]);
        let off_in = |half: &ColumnSums| -> Vec<f32> {
            let means = ColumnSums::moments(&[half]).0;
            means.iter().zip(medians(&means)).map(|(mean, beside)| mean / beside.max(1.0) - 1.0).collect()
        };
        let off: Vec<f32> = off_in(one).into_iter().zip(off_in(other)).map(|(a, b)| agreed(a, b)).collect();
        let (beside, varied_beside) = (medians(&means), medians(&varied));
        let mut order = beside.clone();
        order.sort_unstable_by(f32::total_cmp);
        let lit = (LIT * order.get(3 * order.len() / 4).copied().unwrap_or(0.0)).max(LEAST_GRAY);
        let is_lit = |column: usize| beside[column] >= lit;
        let is_stuck = |column: usize| {
            is_lit(column) && varied_beside[column] >= LEAST_VARIED && varied[column] < STUCK * varied_beside[column]
        };
        let mut faults = vec![Fault::None; means.len()];
        let mut column = 0;
        while column < means.len() {
            let same =
                |k: usize| is_lit(k) && (off[k].abs() >= OFF_BESIDE && off[k] * off[column] > 0.0 || is_stuck(k));
            let run = column..(column..means.len()).find(|&k| !same(k)).unwrap_or(means.len());
            column = run.end.max(column + 1);
            if run.is_empty() || run.len() > BESIDE {
                continue;
            }
            let before = |k: usize| self.faults.get(k).is_some_and(|fault| *fault != Fault::None);
            let least = if run.len() <= 2 {
                OFF_ALONE
            } else if run.clone().any(before) {
                STILL_OFF
            } else {
                OFF
            };
            if !run.clone().any(|k| off[k].abs() >= least || is_stuck(k)) {
                continue;
            }
            // What the columns would have, between those on either side.
            let (mean, spread) = (between(&means, &run), between(&varied, &run));
            for (k, (mean, spread)) in run.clone().zip(mean.into_iter().zip(spread)) {
                let (gain, varies) = (means[k] / mean.max(1.0), varied[k] / spread.max(0.1));
                faults[k] = if is_stuck(k) || gain < BLIND {
                    Fault::Stuck
                } else if (varies - gain).abs() <= (varies - 1.0).abs() {
                    Fault::Gain(gain)
                } else {
                    Fault::Offset(means[k] - mean)
                };
            }
        }
        self.faults = faults;
    }

    /// Columns that say nothing, and those beside them that cannot be judged without, in order.
    pub fn not_judged(&self) -> Vec<Range<usize>> {
        let mut ranges: Vec<Range<usize>> = Vec::new();
        for (column, _) in self.faults.iter().enumerate().filter(|(_, fault)| **fault == Fault::Stuck) {
            let range =
                column.saturating_sub(NOT_JUDGED_BESIDE)..(column + NOT_JUDGED_BESIDE + 1).min(self.faults.len());
            match ranges.last_mut() {
                Some(last) if last.end >= range.start => last.end = range.end,
                _ => ranges.push(range),
            }
        }
        ranges
    }

    /// Whether anything is to be set right.
    pub fn is_faulty(&self) -> bool {
        self.faults.iter().any(|fault| *fault != Fault::None)
    }

    /// Sets an image right.
    pub fn set_right(&self, image: &mut GrayImage) {
        let faulty: Vec<(usize, Fault)> =
            self.faults.iter().copied().enumerate().filter(|(_, fault)| *fault != Fault::None).collect();
        if faulty.is_empty() {
            return;
        }
        let stuck = |column: usize| self.faults[column] == Fault::Stuck;
        // Of a stuck column: the nearest on either side that are not.
        let sides = |column: usize| {
            let left = (0..column).rfind(|&k| !stuck(k));
            let right = (column + 1..self.faults.len()).find(|&k| !stuck(k));
            (left.or(right).unwrap_or(column), right.or(left).unwrap_or(column))
        };
        let tables: Vec<(usize, [u8; 256])> = faulty
            .iter()
            .filter_map(|&(column, fault)| {
                let right = |gray: f32| match fault {
                    Fault::Gain(gain) => gray / gain,
                    Fault::Offset(offset) => gray - offset,
                    Fault::None | Fault::Stuck => gray,
                };
                (fault != Fault::Stuck).then(|| (column, std::array::from_fn(|gray| (right(gray as f32) + 0.5) as u8)))
            })
            .collect();
        let drawn: Vec<(usize, usize, usize)> = faulty
            .iter()
            .filter(|(_, fault)| *fault == Fault::Stuck)
            .map(|&(column, _)| (column, sides(column).0, sides(column).1))
            .collect();
        for line in 0..image.lines() {
            let row = image.line_mut(line);
            for (column, table) in &tables {
                row[*column] = table[usize::from(row[*column])];
            }
            for &(column, left, right) in &drawn {
                let share = if right > left { (column as f32 - left as f32) / (right - left) as f32 } else { 0.0 };
                let (left, right) = (f32::from(row[left]), f32::from(row[right]));
                row[column] = (left + share * (right - left) + 0.5) as u8;
            }
        }
    }
}

/// What both say: the nearer to nothing of the two, nothing if they do not agree.
fn agreed(a: f32, b: f32) -> f32 {
    let (less, more) = if a.abs() < b.abs() { (a, b) } else { (b, a) };
    if less * more > 0.0 && less.abs() >= AGREED * more.abs() { less } else { 0.0 }
}

/// Values on a straight line across a run, between the means of three columns on either side, or of the one side that there is.
fn between(values: &[f32], run: &Range<usize>) -> Vec<f32> {
    let mean = |side: &[f32]| (!side.is_empty()).then(|| side.iter().sum::<f32>() / side.len() as f32);
    let left = mean(&values[run.start.saturating_sub(3)..run.start]);
    let right = mean(&values[run.end..(run.end + 3).min(values.len())]);
    let (left, right) = (left.or(right).unwrap_or(0.0), right.or(left).unwrap_or(0.0));
    // Middles of the sides lie two columns off the run.
    let length = run.len() as f32 + 3.0;
    run.clone().map(|k| left + (right - left) * ((k - run.start) as f32 + 2.0) / length).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 400;
    const ROPE: Range<usize> = 50..350;

    /// A stretch of wires that wander over the sensor, brighter in the middle, before a dark background.
    fn stretch(number: usize, fault: impl Fn(usize, f32) -> f32) -> GrayImage {
        let mut pixels = Vec::new();
        for line in 2000 * number..2000 * (number + 1) {
            for column in 0..WIDTH {
                let (c, l) = (column as f32, line as f32);
                let wires = 1.0 + 0.4 * (0.24 * c + 0.013 * l).sin() + 0.2 * (0.031 * c - 0.0071 * l).sin();
                let body = 90.0 * (1.0 - ((c - 200.0) / 180.0).powi(2));
                let light = if ROPE.contains(&column) { body * wires } else { 8.0 };
                let noise = ((line * 31 + column * 17) % 5) as f32 - 2.0;
                pixels.push((fault(column, light) + noise).clamp(0.0, 255.0) as u8);
            }
        }
        GrayImage::new(WIDTH, pixels).unwrap()
    }

    fn learnt(fault: impl Fn(usize, f32) -> f32) -> Columns {
        let mut columns = Columns::default();
        for number in 0..6 {
            columns.read(&stretch(number, &fault), &LostLines::default());
        }
        columns.learn(6000);
        columns
    }

    /// Greatest mean difference of some columns from what a sensor without fault sees, after they were set right.
    fn off(columns: &Columns, fault: impl Fn(usize, f32) -> f32, looked_at: Range<usize>) -> f32 {
        let (truth, mut image) = (stretch(7, |_, light| light), stretch(7, fault));
        columns.set_right(&mut image);
        let mean = |column: usize| {
            let off = |line: usize| f32::from(image.line(line)[column].abs_diff(truth.line(line)[column]));
            (0..2000).map(off).sum::<f32>() / 2000.0
        };
        looked_at.map(mean).fold(0.0, f32::max)
    }

    #[test]
    fn a_sensor_without_fault_is_left_as_it_is_vignetting_and_broad_shadows_too() {
        assert!(!learnt(|_, light| light).is_faulty());
        let edges = |column: usize, light: f32| light * (1.0 - 0.3 * ((column as f32 - 200.0) / 200.0).powi(2));
        assert!(!learnt(edges).is_faulty());
        assert!(!learnt(|column, light| if (100..140).contains(&column) { 0.7 * light } else { light }).is_faulty());
    }

    #[test]
    fn dust_a_tired_and_a_hot_column_are_set_right() {
        let fault = |column: usize, light: f32| match column {
            120 | 126 => 0.85 * light,
            121..126 => 0.7 * light,
            180 => 0.78 * light,
            230 => light + 16.0,
            _ => light,
        };
        let columns = learnt(fault);
        assert!(off(&Columns::default(), fault, 120..231) > 14.0);
        assert!(off(&columns, fault, 118..129) < 5.0, "{}", off(&columns, fault, 118..129));
        assert!(off(&columns, fault, 170..240) < 4.0, "{}", off(&columns, fault, 170..240));
        assert_eq!(columns.not_judged(), []);
    }

    #[test]
    fn stuck_columns_are_drawn_from_their_neighbours_and_not_judged() {
        let fault = |column: usize, light: f32| match column {
            150 | 152 => 0.0,
            260 => 90.0, // what is usual there
            _ => light,
        };
        let columns = learnt(fault);
        assert_eq!(columns.not_judged(), [148..155, 258..263]);
        assert!(off(&columns, fault, 140..270) < 8.0, "{}", off(&columns, fault, 140..270));
    }

    #[test]
    fn what_only_one_half_of_the_rope_shows_is_the_ropes_and_little_rope_says_nothing() {
        let mut columns = Columns::default();
        let dust = |column: usize, light: f32| if (121..126).contains(&column) { 0.7 * light } else { light };
        for number in 0..6 {
            let image = if number % 2 == 0 { stretch(number, dust) } else { stretch(number, |_, light| light) };
            columns.read(&image, &LostLines::default());
        }
        columns.learn(6000);
        assert!(!columns.is_faulty());
        let mut columns = Columns::default();
        (0..2).for_each(|number| columns.read(&stretch(number, dust), &LostLines::default()));
        columns.learn(6000);
        assert!(!columns.is_faulty());
    }
}
