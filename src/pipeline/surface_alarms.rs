//! Surface alarms counted over windows of rope, as rules for ropes count damage: so many diameters, or a lay length.
//!
//! A surface alarm is a place that does not look as intact rope does. It is not a count of broken wires, which only a person at the
//! rope can give.

use super::results::NotCovered;
use super::windows::{Span, Tally, series, windows_of};
use std::collections::BTreeSet;
use std::io::Write;

/// What the length of a window is counted in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowUnit {
    /// Nominal diameters of the rope.
    Diameter,
    /// Lay lengths of the strands: as measured, else as designed.
    Lay,
}

impl WindowUnit {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Diameter, Self::Lay];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Diameter => "diameter",
            Self::Lay => "lay",
        }
    }
}

/// A window of rope, as rules for ropes state it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RopeWindow {
    /// What its length is counted in.
    pub unit: WindowUnit,
    /// Length in these units.
    pub length: f64,
    /// More surface alarms in it are over the limit; `None`: no limit.
    pub most_surface_alarms: Option<u32>,
}

/// The reference lengths of rules for crane ropes and ropeways, and one lay. Limits depend on rope and rule, so there are none.
pub fn usual() -> Vec<RopeWindow> {
    let diameters = [6.0, 30.0, 40.0, 500.0].map(|length| (WindowUnit::Diameter, length));
    let window = |(unit, length)| RopeWindow { unit, length, most_surface_alarms: None };
    diameters.into_iter().chain([(WindowUnit::Lay, 1.0)]).map(window).collect()
}

/// Where the length of windows comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthOrigin {
    /// From the design of the rope.
    Designed,
    /// From what was measured in this inspection, on average.
    Measured,
}

/// What the units of windows measure. Lay lengths are signed; a window is as long as they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitLengths {
    /// Nominal diameter in mm.
    pub diameter_mm: f64,
    /// Lay length with its origin; `None`: neither measured nor designed.
    pub lay_mm: Option<(f64, LengthOrigin)>,
}

impl UnitLengths {
    /// Of a rope with this diameter and lay by design, and lays as they were measured along it.
    pub fn new(diameter_mm: f64, designed_lay_mm: Option<f64>, measured_lays_mm: impl Iterator<Item = f64>) -> Self {
        let (sum, n) = measured_lays_mm.fold((0.0, 0.0), |(sum, n), lay| (sum + lay.abs(), n + 1.0));
        let measured = (n > 0.0).then_some((sum / n, LengthOrigin::Measured));
        Self { diameter_mm, lay_mm: measured.or(designed_lay_mm.map(|lay| (lay.abs(), LengthOrigin::Designed))) }
    }

    fn length_m(&self, window: RopeWindow) -> Option<(f64, LengthOrigin)> {
        let (unit_mm, origin) = match window.unit {
            WindowUnit::Diameter => (self.diameter_mm, LengthOrigin::Designed),
            WindowUnit::Lay => self.lay_mm?,
        };
        Some((window.length * unit_mm / 1000.0, origin))
    }
}

/// A window of rope with what is in it.
#[derive(Debug, Clone, PartialEq)]
pub struct AlarmWindow {
    /// Where it is.
    pub span: Span,
    /// Surface alarms that touch it.
    pub surface_alarms: usize,
    /// True when that is over the limit; `None` if there is none.
    pub over_limit: Option<bool>,
    /// Metres times views of it that were not inspected. Not covered is not intact.
    pub not_covered_view_m: f64,
    /// Why they were not.
    pub not_covered_reasons: Vec<String>,
}

/// Surface alarms over windows of one length.
#[derive(Debug, Clone, PartialEq)]
pub struct AlarmWindows {
    /// The length as it is stated for the rope, and its limit.
    pub window: RopeWindow,
    /// The length in m with its origin; `None`: it is not known, and there are no windows.
    pub length_m: Option<(f64, LengthOrigin)>,
    /// The window, anywhere on the rope, with most surface alarms.
    pub worst: Option<AlarmWindow>,
    /// Windows side by side along the rope.
    pub series: Vec<AlarmWindow>,
    /// Why there are none; `None` if there are.
    pub reason: Option<&'static str>,
}

/// What is counted, and where.
pub struct SurfaceAlarms<'a> {
    rope: Span,
    lengths: UnitLengths,
    tally: Tally,
    not_covered: &'a [NotCovered],
}

impl<'a> SurfaceAlarms<'a> {
    /// Surface alarms at these places of a rope.
    pub fn new(rope: Span, lengths: UnitLengths, places: &[Span], not_covered: &'a [NotCovered]) -> Self {
        Self { rope, lengths, tally: Tally::new(places), not_covered }
    }

    /// How many windows side by side of this length there are, and how long each is in m.
    pub fn windows_of(&self, window: RopeWindow) -> (usize, f64) {
        self.lengths.length_m(window).map_or((0, 0.0), |(length_m, _)| (windows_of(self.rope, length_m), length_m))
    }

    /// Counts over windows of one length.
    pub fn over(&self, window: RopeWindow) -> AlarmWindows {
        let length = self.lengths.length_m(window);
        let Some((length_m, _)) = length else {
            let reason = Some("no lay length was measured and the design states none");
            return AlarmWindows { window, length_m: None, worst: None, series: Vec::new(), reason };
        };
        AlarmWindows {
            window,
            length_m: length,
            worst: Some(self.look(self.tally.worst(self.rope, length_m), window)),
            series: series(self.rope, length_m).map(|span| self.look(span, window)).collect(),
            reason: None,
        }
    }

    fn look(&self, span: Span, window: RopeWindow) -> AlarmWindow {
        let surface_alarms = self.tally.count(&span);
        let mut not_covered_view_m = 0.0;
        let mut reasons = BTreeSet::new();
        for gap in self.not_covered {
            let overlap_m = span.overlap_m(&Span { from_m: gap.from_m, to_m: gap.to_m });
            if overlap_m > 0.0 {
                not_covered_view_m += overlap_m;
                reasons.insert(gap.reason.clone());
            }
        }
        AlarmWindow {
            span,
            surface_alarms,
            over_limit: window.most_surface_alarms.map(|most| surface_alarms > most as usize),
            not_covered_view_m,
            not_covered_reasons: reasons.into_iter().collect(),
        }
    }
}

/// Writes a table: of every length the worst window, then all side by side.
pub fn write_csv(windows: &[AlarmWindows], to: impl Write) -> csv::Result<()> {
    let mut table = csv::Writer::from_writer(to);
    table.write_record([
        "unit",
        "length",
        "length_m",
        "place",
        "from_m",
        "to_m",
        "surface_alarms",
        "most_surface_alarms",
        "over_limit",
        "not_covered_view_m",
        "not_covered_reasons",
    ])?;
    for AlarmWindows { window, length_m, worst, series, .. } in windows {
        let places = worst.iter().map(|w| ("worst", w)).chain(series.iter().map(|w| ("series", w)));
        for (place, found) in places {
            table.write_record([
                window.unit.name().to_owned(),
                window.length.to_string(),
                cell(length_m.map(|(length_m, _)| to_um(length_m))),
                place.to_owned(),
                to_um(found.span.from_m).to_string(),
                to_um(found.span.to_m).to_string(),
                found.surface_alarms.to_string(),
                cell(window.most_surface_alarms),
                cell(found.over_limit),
                to_um(found.not_covered_view_m).to_string(),
                found.not_covered_reasons.join("; "),
            ])?;
        }
    }
    table.flush()?;
    Ok(())
}

/// Metres to the micrometre: what is beyond is rounding.
fn to_um(metres: f64) -> f64 {
    (metres * 1e6).round() / 1e6
}

/// A cell; empty if there is no value.
fn cell<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(String::new, |v| v.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(windows: &[AlarmWindows]) -> Vec<String> {
        let mut bytes = Vec::new();
        write_csv(windows, &mut bytes).unwrap();
        String::from_utf8(bytes).unwrap().lines().skip(1).map(str::to_owned).collect()
    }

    #[test]
    fn the_table_has_the_worst_window_first_then_all_side_by_side_with_gaps_and_limits() {
        let gap = NotCovered { view: 1, from_m: 100.75, to_m: 101.0, reason: "oil".into() };
        let lengths = UnitLengths::new(20.0, None, [-250.0, -250.0].into_iter());
        let rope = Span { from_m: 100.0, to_m: 101.0 };
        let places = [Span { from_m: 100.48, to_m: 100.49 }, Span { from_m: 100.51, to_m: 100.52 }];
        let gaps = [gap];
        let alarms = SurfaceAlarms::new(rope, lengths, &places, &gaps);
        let window = RopeWindow { unit: WindowUnit::Lay, length: 2.0, most_surface_alarms: Some(1) };
        assert_eq!(alarms.windows_of(window), (2, 0.5));
        let counted = alarms.over(window);
        assert_eq!(counted.length_m, Some((0.5, LengthOrigin::Measured)));
        assert_eq!(counted.worst.as_ref().map(|w| (w.surface_alarms, w.over_limit)), Some((2, Some(true))));
        let rows = lines(&[counted]);
        assert_eq!(rows.len(), 3);
        assert!(rows[0].starts_with("lay,2,0.5,worst,100.") && rows[0].contains(",2,1,true,"), "{}", rows[0]);
        assert_eq!(rows[1], "lay,2,0.5,series,100,100.5,1,1,false,0,");
        assert_eq!(rows[2], "lay,2,0.5,series,100.5,101,1,1,false,0.25,oil");
    }

    #[test]
    fn without_a_lay_length_there_are_no_windows_but_a_reason() {
        let lengths = UnitLengths::new(20.0, None, std::iter::empty());
        let alarms = SurfaceAlarms::new(Span { from_m: 0.0, to_m: 1.0 }, lengths, &[], &[]);
        let counted: Vec<AlarmWindows> = usual().into_iter().map(|window| alarms.over(window)).collect();
        assert!(counted[4].reason.is_some() && counted[4].worst.is_none());
        let rows = lines(&counted);
        assert!(rows.iter().all(|row| row.starts_with("diameter,")), "{rows:?}");
        assert_eq!(
            rows.len(),
            4 + 9 + 2 + 2 + 1,
            "windows of 0.12, 0.6, 0.8 and 10 m on a metre, and the worst of each"
        );
        let designed = UnitLengths::new(20.0, Some(-137.5), std::iter::empty());
        assert_eq!(designed.lay_mm, Some((137.5, LengthOrigin::Designed)));
    }
}
