//! Gray profiles as curves: what was seen against what is usual.

use super::canvas::{Canvas, Colour, Size};
use crate::pipeline::profile::ProfilePoint;

/// Colours of a plot.
pub(super) struct Colours {
    pub ground: Colour,
    pub alarm: Colour,
    pub ink: Colour,
    pub usual: Colour,
    pub expected: Colour,
    pub observed: Colour,
}

/// Where a plot lies on the sheet, in dots.
#[derive(Clone, Copy)]
pub(super) struct Area {
    pub x: i64,
    pub y: i64,
    pub width: i64,
    pub height: i64,
}

/// Room for the numbers of the gray axis.
const LEFT: i64 = 40;
/// Room for the numbers of the other axis.
const BELOW: i64 = 42;
/// The gray axis goes so much beyond the highest value, that no curve runs along the edge or over it.
const HEADROOM: f32 = 1.05;

/// Draws a profile with its axes; from `from_mm` to `to_mm` it is alarmed.
pub(super) fn profile(
    canvas: &mut Canvas,
    area: Area,
    colours: &Colours,
    points: &[ProfilePoint],
    (from_mm, to_mm): (f64, f64),
    label: &str,
) {
    let (x, y, width, height) = (area.x + LEFT, area.y, area.width - LEFT, area.height - BELOW);
    canvas.fill(x, y, width, height, colours.ground);
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        canvas.text(x + 12, y + 12, Size::Body, colours.ink, "no pixel here shows a known surface");
        return;
    };
    let top = points.iter().fold(40.0f32, |top, p| top.max(p.observed).max(p.usual.1)).min(255.0) * HEADROOM;
    let span_mm = (last.at_mm - first.at_mm).max(1e-6);
    let x_of = |mm: f64| x + ((mm - first.at_mm) / span_mm * (width - 1) as f64).round() as i64;
    let y_of = |gray: f32| y + height - 1 - (gray.clamp(0.0, top) / top * (height - 1) as f32).round() as i64;
    let (from, to) = (x_of(from_mm.max(first.at_mm)), x_of(to_mm.min(last.at_mm)));
    canvas.fill(from, y, (to - from).max(2), height, colours.alarm);
    for (at, point) in points.iter().enumerate() {
        // Each point stands for the dots up to the next one, unless there is a gap.
        let next = points.get(at + 1).map_or(point.at_mm, |n| n.at_mm);
        let step = 3.0 * span_mm / points.len() as f64;
        let wide = if next - point.at_mm < step { (x_of(next) - x_of(point.at_mm)).max(1) } else { 1 };
        let (upper, lower) = (y_of(point.usual.1), y_of(point.usual.0));
        canvas.fill(x_of(point.at_mm), upper, wide, lower - upper + 1, colours.usual);
    }
    for gray in [0.0, 50.0, 100.0, 150.0, 200.0, 250.0].into_iter().filter(|&g| g <= top) {
        canvas.fill(x - 4, y_of(gray), 4, 1, colours.ink);
        let number = format!("{gray:3}");
        canvas.text(x - 8 - Size::Body.width(&number), y_of(gray) - 8, Size::Body, colours.ink, &number);
    }
    let step_mm = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
        .into_iter()
        .find(|step| span_mm / step <= 10.0)
        .unwrap_or(200.0);
    let mut tick = (first.at_mm / step_mm).ceil();
    while tick * step_mm <= last.at_mm {
        // Plus 0, because the minus of a rounded zero would be written.
        let (at, number) = (x_of(tick * step_mm), format!("{}", (tick * step_mm * 10.0).round() / 10.0 + 0.0));
        canvas.fill(at, y + height, 1, 4, colours.ink);
        canvas.text(at - Size::Body.width(&number) / 2, y + height + 6, Size::Body, colours.ink, &number);
        tick += 1.0;
    }
    canvas.text(x + (width - Size::Body.width(label)) / 2, y + height + 24, Size::Body, colours.ink, label);
    let curve = |of: fn(&ProfilePoint) -> f32| -> Vec<(i64, i64)> {
        points.iter().map(|p| (x_of(p.at_mm), y_of(of(p)))).collect()
    };
    canvas.lines(&curve(|p| p.expected), 2, colours.expected);
    canvas.lines(&curve(|p| p.observed), 2, colours.observed);
}
