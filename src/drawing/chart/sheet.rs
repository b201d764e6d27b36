//! Charts side by side as one SVG, each with its axes, title and legend.

use super::axis::Scale;
use super::marks::{Frame, Mark, Swatch, line, rectangle};
use std::fmt::Write;

/// One chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// What it shows, in a few words.
    pub title: String,
    /// Name and unit of the horizontal axis.
    pub x_label: String,
    /// Name and unit of the vertical axis.
    pub y_label: String,
    /// The horizontal axis.
    pub horizontal: Scale,
    /// The vertical axis.
    pub vertical: Scale,
    /// What is drawn, the first below the others.
    pub marks: Vec<Mark>,
}

/// Sizes in dots.
const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 330.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const ABOVE: f64 = 34.0;
const BELOW: f64 = 52.0;
const LEGEND_ROW: f64 = 18.0;
/// About the width of a letter, to set the legend.
const LETTER: f64 = 6.3;

const PAPER: &str = "#ffffff";
const INK: &str = "#2b3038";
const FAINT: &str = "#6b7280";
const GRID: &str = "#e4e7eb";

/// The charts in rows of `columns`, as a complete SVG document.
pub fn svg(charts: &[Chart], columns: usize) -> String {
    let columns = columns.clamp(1, charts.len().max(1));
    let rows = charts.len().div_ceil(columns);
    let legend = charts.iter().map(|c| legend_rows(c).len()).max().unwrap_or(0) as f64 * LEGEND_ROW;
    let (width, height) = (WIDTH * columns as f64, (HEIGHT + legend) * rows as f64);
    let mut out = format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" font-family="Helvetica, Arial, 'Liberation Sans', sans-serif">
"#
    );
    rectangle(0.0, 0.0, width, height, PAPER, 1.0, &mut out);
    for (n, chart) in charts.iter().enumerate() {
        let (x, y) = ((n % columns) as f64 * WIDTH, (n / columns) as f64 * (HEIGHT + legend));
        draw(chart, x, y, &mut out);
    }
    out += "</svg>\n";
    out
}

fn draw(chart: &Chart, x: f64, y: f64, out: &mut String) {
    let frame = Frame {
        x: x + LEFT,
        y: y + ABOVE,
        width: WIDTH - LEFT - RIGHT,
        height: HEIGHT - ABOVE - BELOW,
        horizontal: &chart.horizontal,
        vertical: &chart.vertical,
    };
    let (right, bottom) = (frame.x + frame.width, frame.y + frame.height);
    text(frame.x, y + 21.0, "start", 14.0, INK, &chart.title, out);
    for (value, number) in chart.vertical.ticks() {
        let at = frame.y_of(value);
        line((frame.x, at), (right, at), GRID, 1.0, out);
        text(frame.x - 7.0, at + 4.0, "end", 11.0, FAINT, &number, out);
    }
    for (value, number) in chart.horizontal.ticks() {
        let at = frame.x_of(value);
        line((at, bottom), (at, bottom + 4.0), FAINT, 1.0, out);
        text(at, bottom + 17.0, "middle", 11.0, FAINT, &number, out);
    }
    for mark in &chart.marks {
        mark.draw(&frame, out);
    }
    line((frame.x, bottom), (right, bottom), FAINT, 1.0, out);
    line((frame.x, frame.y), (frame.x, bottom), FAINT, 1.0, out);
    text((frame.x + right) / 2.0, bottom + 36.0, "middle", 12.0, INK, &chart.x_label, out);
    let (tx, ty) = (x + 16.0, (frame.y + bottom) / 2.0);
    let label = escaped(&chart.y_label);
    let _ = writeln!(
        out,
        r#"<text x="{tx:.1}" y="{ty:.1}" transform="rotate(-90 {tx:.1} {ty:.1})" text-anchor="middle" font-size="12" fill="{INK}">{label}</text>"#
    );
    for (row, entries) in legend_rows(chart).into_iter().enumerate() {
        let at = bottom + 54.0 + LEGEND_ROW * row as f64;
        let mut x = frame.x;
        for (colour, label, swatch) in entries {
            swatch.draw(x, at - 4.0, colour, out);
            text(x + 24.0, at, "start", 11.5, INK, label, out);
            x += entry_width(label);
        }
    }
}

fn entry_width(label: &str) -> f64 {
    42.0 + LETTER * label.chars().count() as f64
}

/// Legend entries of a chart, as many in a row as fit.
fn legend_rows(chart: &Chart) -> Vec<Vec<(&'static str, &str, Swatch)>> {
    let mut rows: Vec<Vec<_>> = Vec::new();
    let mut used = f64::INFINITY;
    for entry in chart.marks.iter().filter_map(Mark::legend) {
        let width = entry_width(entry.1);
        if used + width > WIDTH - LEFT {
            rows.push(Vec::new());
            used = 0.0;
        }
        used += width;
        if let Some(row) = rows.last_mut() {
            row.push(entry);
        }
    }
    rows
}

fn text(x: f64, y: f64, anchor: &str, size: f64, colour: &str, words: &str, out: &mut String) {
    let words = escaped(words);
    let _ = writeln!(
        out,
        r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}" font-size="{size}" fill="{colour}">{words}</text>"#
    );
}

fn escaped(words: &str) -> String {
    words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::super::{Boxed, COLOURS};
    use super::*;

    #[test]
    fn a_chart_is_whole_xml_with_its_marks_words_and_legend() {
        let chart = Chart {
            title: "errors < 1 & more".into(),
            x_label: "noise, px".into(),
            y_label: "error, mm".into(),
            horizontal: Scale::names(["0.5".into(), "1".into()]),
            vertical: Scale::linear(0.0, 0.1),
            marks: vec![
                Mark::Boxes {
                    boxes: vec![Boxed { x: 0.0, width: 0.5, values: [0.0, 0.01, 0.02, 0.03, 0.05] }],
                    colour: COLOURS[0],
                    label: "strands".into(),
                },
                Mark::Curve { points: vec![(0.0, 0.02)], colour: COLOURS[2], dashed: true, label: "limit".into() },
                Mark::Curve {
                    points: vec![(0.0, 0.01), (0.5, f64::NAN), (1.0, 0.02)],
                    colour: COLOURS[1],
                    dashed: true,
                    label: String::new(),
                },
            ],
        };
        let drawn = svg(&[chart.clone(), chart], 2);
        assert!(drawn.starts_with("<svg ") && drawn.ends_with("</svg>\n"));
        assert_eq!(drawn.matches("errors &lt; 1 &amp; more").count(), 2);
        assert_eq!(drawn.matches(">strands</text>").count(), 2); // the curve has no words, so it is not in the legend
        assert_eq!(drawn.matches("<polyline").count(), 6); // and breaks where it is not finite
        let dashes = format!(r#"width="7.0" height="2.4" fill="{}""#, COLOURS[2]);
        assert_eq!(drawn.matches(&dashes).count(), 4, "a dashed line has two dashes in the legend\n{drawn}");
        assert!(!drawn.contains("NaN") && drawn.contains(r#"width="960""#));
    }
}
