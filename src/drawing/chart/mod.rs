//! Charts for reports, as SVG: axes, curves, boxes, steps, squares, side by side in panels.

mod axis; // scales and ticks
mod marks; // what is drawn into a chart
mod sheet; // panels, axes and legends as one SVG

pub use axis::Scale;
pub use marks::{Boxed, Mark};
pub use sheet::{Chart, svg};

/// Colours that differ for people who do not see red and green apart, too, darkest first.
pub const COLOURS: [&str; 6] = ["#1f4e79", "#d1691c", "#3a8f6f", "#8c4a97", "#b8a11a", "#5a6270"];
