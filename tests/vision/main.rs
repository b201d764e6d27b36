//! Known answers: ropes whose lays and phases are known, and what the method makes of their images.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

mod contours; // edges of drawn ropes
mod details; // the image about a place, and burns in it
mod lost_lines; // a camera that loses lines
mod reference; // the fast alignment against the paper's own
mod simulated_ropes; // folder in, errors out
mod stuck_columns; // a sensor with columns that say nothing
mod training; // folders in, a model out
