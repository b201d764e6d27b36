//! The method of Wacker & Denzler, "Enhanced Anomaly Detection in Wire Ropes by Combining Structure and Appearance"
//! (cited as [Wacker13]): numbers and images in, numbers and images out.

pub mod aligner;
pub mod camera;
pub mod camera_distance;
pub mod contour;
pub mod displacement;
pub mod estimates;
pub mod image;
mod lock;
pub mod model_contour;
pub mod registration;
pub mod rope;
pub mod simplex;
pub mod smoothing;
pub mod strand;
pub mod strand_alignment;
pub mod stretch;
pub mod surface;
pub mod template;
pub mod unwrapping;
pub mod wire;
pub mod wire_pattern;
pub mod wire_tracking;
