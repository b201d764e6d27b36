//! Pictures for people: a sheet to draw on, curves, and the card that says why something is a defect.

mod canvas;
mod plot;
pub mod why_card;

pub use canvas::{Canvas, Colour, Size, heat};
