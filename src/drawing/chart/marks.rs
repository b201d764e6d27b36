//! What is drawn into a chart. Points are (x, y) in the units of the axes.

use super::axis::Scale;
use std::fmt::Write;

/// A box with whiskers.
#[derive(Debug, Clone, PartialEq)]
pub struct Boxed {
    /// Its place on the horizontal axis.
    pub x: f64,
    /// Its width there.
    pub width: f64,
    /// Lower whisker, lower quartile, median, upper quartile, upper whisker.
    pub values: [f64; 5],
}

/// One thing in a chart. `label` is for the legend; empty is for none.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields' names say what they are")]
pub enum Mark {
    /// A curve. It breaks where a value is not finite.
    Curve { points: Vec<(f64, f64)>, colour: &'static str, dashed: bool, label: String },
    /// An area between two curves: (x, low, high).
    Band { points: Vec<(f64, f64, f64)>, colour: &'static str, label: String },
    /// Boxes.
    Boxes { boxes: Vec<Boxed>, colour: &'static str, label: String },
    /// Short horizontal lines, such as limits: (x, y), each `width` wide.
    Limits { points: Vec<(f64, f64)>, width: f64, colour: &'static str, label: String },
    /// Filled squares, as the paper marks 50 % recovery.
    Squares { points: Vec<(f64, f64)>, colour: &'static str, label: String },
    /// Dots.
    Dots { points: Vec<(f64, f64)>, colour: &'static str, label: String },
}

/// What stands for a mark in the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Swatch {
    Line,
    Dashes,
    Area,
}

impl Swatch {
    /// Appends it to an SVG, its left end at `x`, its middle at `y`.
    pub fn draw(self, x: f64, y: f64, colour: &str, out: &mut String) {
        match self {
            Self::Line => rectangle(x, y - 1.2, 18.0, 2.4, colour, 1.0, out),
            Self::Dashes => [x, x + 11.0].into_iter().for_each(|x| rectangle(x, y - 1.2, 7.0, 2.4, colour, 1.0, out)),
            Self::Area => rectangle(x, y - 5.0, 18.0, 10.0, colour, 0.55, out),
        }
    }
}

/// Where a chart's axes lie on the sheet in dots.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a> {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
    pub horizontal: &'a Scale,
    pub vertical: &'a Scale,
}

impl Frame<'_> {
    pub fn x_of(&self, value: f64) -> f64 {
        self.x + self.width * self.horizontal.share(value)
    }

    pub fn y_of(&self, value: f64) -> f64 {
        self.y + self.height * (1.0 - self.vertical.share(value))
    }
}

impl Mark {
    /// Colour and words of the legend, and what stands for it there; `None` if it has no words.
    pub(super) fn legend(&self) -> Option<(&'static str, &str, Swatch)> {
        let (colour, label, swatch) = match self {
            Self::Curve { colour, label, dashed: true, .. } => (colour, label, Swatch::Dashes),
            Self::Curve { colour, label, .. } | Self::Limits { colour, label, .. } => (colour, label, Swatch::Line),
            Self::Band { colour, label, .. }
            | Self::Boxes { colour, label, .. }
            | Self::Squares { colour, label, .. }
            | Self::Dots { colour, label, .. } => (colour, label, Swatch::Area),
        };
        (!label.is_empty()).then_some((*colour, label.as_str(), swatch))
    }

    /// Appends the mark to an SVG.
    pub(super) fn draw(&self, frame: &Frame<'_>, out: &mut String) {
        let at = |x: f64, y: f64| format!("{:.1},{:.1}", frame.x_of(x), frame.y_of(y));
        match self {
            Self::Curve { points, colour, dashed, .. } => {
                let dash = if *dashed { r#" stroke-dasharray="6 4""# } else { "" };
                for run in points.split(|p| !(p.0.is_finite() && p.1.is_finite())).filter(|run| !run.is_empty()) {
                    let path: Vec<String> = run.iter().map(|p| at(p.0, p.1)).collect();
                    let _ = writeln!(
                        out,
                        r#"<polyline points="{}" fill="none" stroke="{colour}" stroke-width="1.6" stroke-linejoin="round"{dash}/>"#,
                        path.join(" ")
                    );
                }
            }
            Self::Band { points, colour, .. } => {
                let there = points.iter().map(|p| at(p.0, p.1));
                let back = points.iter().rev().map(|p| at(p.0, p.2));
                let path: Vec<String> = there.chain(back).collect();
                let _ = writeln!(
                    out,
                    r#"<polygon points="{}" fill="{colour}" fill-opacity="0.28" stroke="{colour}" stroke-opacity="0.4" stroke-width="7" stroke-linejoin="round"/>"#,
                    path.join(" ")
                );
            }
            Self::Boxes { boxes, colour, .. } => boxes.iter().for_each(|b| draw_box(b, colour, frame, out)),
            Self::Limits { points, width, colour, .. } => {
                for &(x, y) in points {
                    let (from, to) = (frame.x_of(x - width / 2.0), frame.x_of(x + width / 2.0));
                    line((from, frame.y_of(y)), (to, frame.y_of(y)), colour, 2.2, out);
                }
            }
            Self::Squares { points, colour, .. } => {
                for &(x, y) in points {
                    rectangle(frame.x_of(x) - 4.0, frame.y_of(y) - 4.0, 8.0, 8.0, colour, 1.0, out);
                }
            }
            Self::Dots { points, colour, .. } => {
                for &(x, y) in points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()) {
                    let (x, y) = (frame.x_of(x), frame.y_of(y));
                    let _ = writeln!(
                        out,
                        r#"<circle cx="{x:.1}" cy="{y:.1}" r="3.2" fill="{colour}" stroke="white" stroke-width="0.6"/>"#
                    );
                }
            }
        }
    }
}

fn draw_box(boxed: &Boxed, colour: &str, frame: &Frame<'_>, out: &mut String) {
    let [low, lower, median, upper, high] = boxed.values.map(|v| frame.y_of(v));
    let (from, to) = (frame.x_of(boxed.x - boxed.width / 2.0), frame.x_of(boxed.x + boxed.width / 2.0));
    let (middle, quarter) = ((from + to) / 2.0, (to - from) / 4.0);
    line((middle, low), (middle, lower), colour, 1.2, out);
    line((middle, upper), (middle, high), colour, 1.2, out);
    for end in [low, high] {
        line((middle - quarter, end), (middle + quarter, end), colour, 1.2, out);
    }
    let _ = writeln!(
        out,
        r#"<rect x="{from:.1}" y="{upper:.1}" width="{:.1}" height="{:.1}" fill="{colour}" fill-opacity="0.22" stroke="{colour}" stroke-width="1.2"/>"#,
        to - from,
        (lower - upper).max(0.5)
    );
    line((from, median), (to, median), colour, 2.4, out);
}

pub(super) fn line(from: (f64, f64), to: (f64, f64), colour: &str, width: f64, out: &mut String) {
    let _ = writeln!(
        out,
        r#"<line x1="{:.1}" y1="{:.1}" x2="{:.1}" y2="{:.1}" stroke="{colour}" stroke-width="{width}"/>"#,
        from.0, from.1, to.0, to.1
    );
}

pub(super) fn rectangle(x: f64, y: f64, width: f64, height: f64, colour: &str, opacity: f64, out: &mut String) {
    let _ = writeln!(
        out,
        r#"<rect x="{x:.1}" y="{y:.1}" width="{:.1}" height="{:.1}" fill="{colour}" fill-opacity="{opacity}"/>"#,
        width.max(0.0),
        height.max(0.0)
    );
}
