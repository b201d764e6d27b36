//! The card of a defect: why it is one, on one sheet. What the camera saw, how unlikely that is, how intact rope looks there, and
//! the gray values behind it.

use super::canvas::{Canvas, Colour, Size, heat};
use super::captions::Captions;
use super::plot::{Area, Colours, profile};
use crate::pipeline::closeup::Closeup;
use crate::pipeline::results::AlarmRow;
use crate::vision::image::GrayImage;
use image::RgbImage;
use image::imageops::{FilterType, resize};
use std::borrow::Cow;

const PAPER: Colour = [250, 250, 248];
const INK: Colour = [40, 44, 52];
const FAINT: Colour = [120, 124, 132];
/// What was not judged, as in maps.
const NOT_JUDGED: Colour = [205, 205, 205];
const ALARM: Colour = [225, 85, 25];
const PLOT: Colours = Colours {
    ground: [240, 241, 242],
    alarm: [250, 226, 212],
    ink: FAINT,
    usual: [190, 220, 224],
    expected: [0, 130, 150],
    observed: ALARM,
};

/// Sizes in dots.
const MARGIN: i64 = 36;
const WIDTH: i64 = 1280;
const GAP: i64 = 22;
const PATCH: i64 = (WIDTH - 2 * MARGIN - 2 * GAP) / 3;
/// Highest patch: beyond this it is made smaller instead.
const MAX_PATCH: i64 = 460;
const PLOT_HEIGHT: i64 = 250;
/// From one line of text to the next.
const HEADING_ROW: i64 = 24;
const BODY_ROW: i64 = 22;
const PLOT_WIDTH: i64 = (WIDTH - 2 * MARGIN - GAP) / 2;

/// Draws the card of an alarm.
pub fn draw(captions: &Captions, closeup: &Closeup, alarm: &AlarmRow) -> RgbImage {
    let layout = Layout::new(closeup);
    let (title, facts) = (broken(&captions.title, Size::Heading), captions.facts.iter());
    let facts: Vec<_> = facts.flat_map(|fact| broken(fact, Size::Body)).collect();
    let below_title = MARGIN - 6 + HEADING_ROW * title.len() as i64 + 8;
    let head = below_title + BODY_ROW * facts.len() as i64 + 16;
    let plots = head + 24 + layout.height + 44;
    let height = plots + 30 + PLOT_HEIGHT + MARGIN / 2;
    let mut canvas = Canvas::new(WIDTH as u32, height as u32, PAPER);
    for (row, title) in (0..).zip(&title) {
        canvas.text(MARGIN, MARGIN - 6 + HEADING_ROW * row, Size::Heading, INK, title);
    }
    for (row, fact) in (0..).zip(&facts) {
        canvas.text(MARGIN, below_title + BODY_ROW * row, Size::Body, FAINT, fact);
    }
    let mut x = MARGIN;
    let mut patch = |title: &str, patch: &GrayImage, colour: fn(u8) -> Colour| {
        canvas.text(x, head, Size::Body, INK, title);
        layout.paste(&mut canvas, x, head + 24, patch, colour);
        layout.mark(&mut canvas, x, head + 24, closeup, alarm);
        x += PATCH + GAP;
    };
    patch("what the camera saw", &closeup.observed, |gray| [gray; 3]);
    patch("likelihood: it glows where unlikely", &closeup.likelihood, |gray| {
        if gray == 255 { NOT_JUDGED } else { heat(gray) }
    });
    patch("intact rope, as the model knows it", &closeup.intact, |gray| [gray; 3]);
    layout.scale_bar(&mut canvas, MARGIN, head + 24 + layout.height + 10);
    legend(&mut canvas, plots);
    let mm_of = |line: usize| (line as f64 - closeup.peak.0 as f64) * closeup.pitch_mm;
    let alarmed = (mm_of(alarm.first_line), mm_of(alarm.last_line + 1));
    let area = |x| Area { x, y: plots + 30, width: PLOT_WIDTH, height: PLOT_HEIGHT };
    profile(&mut canvas, area(MARGIN), &PLOT, &closeup.along, alarmed, "along the wire through the peak, mm from it");
    let right = area(MARGIN + PLOT_WIDTH + GAP);
    let mm_of = |column: usize| (column as f64 - closeup.axis_px) / closeup.px_per_mm;
    let alarmed = (mm_of(alarm.first_column), mm_of(alarm.last_column + 1));
    profile(&mut canvas, right, &PLOT, &closeup.across, alarmed, "across the wires at the peak, mm from the rope axis");
    canvas.0
}

/// A text in lines that the sheet is wide enough for.
fn broken(text: &str, size: Size) -> Vec<Cow<'_, str>> {
    let letters = (WIDTH - 2 * MARGIN) / size.width(" ");
    textwrap::wrap(text, textwrap::Options::new(letters as usize).subsequent_indent("  "))
}

fn legend(canvas: &mut Canvas, y: i64) {
    let mut x = canvas.text(MARGIN, y, Size::Body, INK, "gray value:") + 18;
    for (colour, high, text) in [
        (PLOT.observed, 3, "observed"),
        (PLOT.expected, 3, "expected of intact rope"),
        (PLOT.usual, 13, "usual: 9 of 10 on intact rope"),
        (PLOT.alarm, 13, "alarm"),
    ] {
        canvas.fill(x, y + 8 - high / 2, 24, high, colour);
        x = canvas.text(x + 32, y, Size::Body, INK, text) + 26;
    }
}

/// How lines and columns of a close-up lie on the sheet: the rope lies, in its own proportions.
struct Layout {
    width: i64,
    height: i64,
    dots_per_mm: f64,
    dots_per_line: f64,
    dots_per_column: f64,
}

impl Layout {
    fn new(closeup: &Closeup) -> Self {
        let long_mm = closeup.lines.len() as f64 * closeup.pitch_mm;
        let wide_mm = closeup.columns.len() as f64 / closeup.px_per_mm;
        let dots_per_mm = (PATCH as f64 / long_mm).min(MAX_PATCH as f64 / wide_mm);
        Self {
            width: ((long_mm * dots_per_mm) as i64).max(1),
            height: ((wide_mm * dots_per_mm) as i64).max(1),
            dots_per_mm,
            dots_per_line: dots_per_mm * closeup.pitch_mm,
            dots_per_column: dots_per_mm / closeup.px_per_mm,
        }
    }

    fn paste(&self, canvas: &mut Canvas, x: i64, y: i64, patch: &GrayImage, colour: fn(u8) -> Colour) {
        let (columns, lines) = (patch.width() as u32, patch.lines() as u32);
        let Some(upright) = image::GrayImage::from_raw(columns, lines, patch.pixels().to_vec()) else { return };
        let upright = resize(&upright, self.height as u32, self.width as u32, FilterType::Triangle);
        for (column, line, &image::Luma([gray])) in upright.enumerate_pixels() {
            canvas.dot(x + i64::from(line), y + i64::from(column), colour(gray));
        }
    }

    /// Frames the alarm, and shows at the edges where the profiles run.
    fn mark(&self, canvas: &mut Canvas, x: i64, y: i64, closeup: &Closeup, alarm: &AlarmRow) {
        let x_of = |line: usize| {
            x + ((line as f64 - closeup.lines.start as f64) * self.dots_per_line).clamp(0.0, self.width as f64) as i64
        };
        let y_of = |column: usize| {
            let dots = (column as f64 - closeup.columns.start as f64) * self.dots_per_column;
            y + dots.clamp(0.0, self.height as f64) as i64
        };
        let (left, right) = ((x_of(alarm.first_line) - 4).max(x), (x_of(alarm.last_line + 1) + 4).min(x + self.width));
        let upper = (y_of(alarm.first_column) - 4).max(y);
        let lower = (y_of(alarm.last_column + 1) + 4).min(y + self.height);
        canvas.frame(left, upper, right - left, lower - upper, ALARM);
        let (peak_x, peak_y) = (x_of(closeup.peak.0), y_of(closeup.peak.1));
        for (from, to) in [(y, y + 10), (y + self.height - 10, y + self.height)] {
            canvas.lines(&[(peak_x, from), (peak_x, to)], 2, ALARM);
        }
        for (from, to) in [(x, x + 10), (x + self.width - 10, x + self.width)] {
            canvas.lines(&[(from, peak_y), (to, peak_y)], 2, ALARM);
        }
    }

    fn scale_bar(&self, canvas: &mut Canvas, x: i64, y: i64) {
        let mm = if self.width as f64 / self.dots_per_mm > 30.0 { 10.0 } else { 5.0 };
        let dots = (mm * self.dots_per_mm) as i64;
        canvas.fill(x, y + 6, dots, 3, INK);
        canvas.text(x + dots + 10, y, Size::Body, FAINT, &format!("{mm} mm; rope metres run to the right"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn however_much_is_said_it_stays_on_the_sheet() {
        let fact = "further alarms: 18.3 in view 2, 17.9 in view 0, ".repeat(9) + &"w".repeat(300);
        for size in [Size::Body, Size::Heading] {
            let lines = broken(&fact, size);
            assert!(lines.len() > 3 && lines.iter().all(|line| size.width(line) <= WIDTH - 2 * MARGIN), "{lines:?}");
            let letters = |text: &str| text.chars().filter(|c| !c.is_whitespace()).count();
            assert_eq!(lines.iter().map(|line| letters(line)).sum::<usize>(), letters(&fact), "nothing is left out");
        }
        assert_eq!(broken("score 9.0 in view 1", Size::Body), ["score 9.0 in view 1"]);
    }
}
