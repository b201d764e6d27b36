//! Pictures for people: a sheet to draw on, curves, the card that says why something is a defect, and the charts of
//! reports.

mod canvas;
pub mod captions;
pub mod chart; // charts for reports
mod plot;
pub mod why_card;

pub use canvas::{Canvas, Colour, Size, heat};
