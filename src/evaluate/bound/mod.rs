//! What nobody can beat: Cramer-Rao bounds of lay lengths, computed for a setting from the geometry of the rope and the noise.
//!
//! The rope's geometry is written down here a second time, on purpose: who judges the estimates must not share code with who made
//! them. [Wacker13, eq. 1-8]

mod image; // what the gray values of an image know, beside the contours
mod lay; // from information about phases to the error of a lay length
mod seen; // the rope as a camera sees it: outlines, wires, and what moves them
mod sequence; // the same for a sequence whose lay drifts

pub use image::{GrayNoise, ImageBound, KnownLine, image_bound};
pub use lay::{contour_bound_mm, mean_abs, usual_contour_bound_mm};
pub use seen::SeenRope;
pub use sequence::{Drift, sequence_bound_mm};
