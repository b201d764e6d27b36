//! The method of Wacker & Denzler, "Enhanced Anomaly Detection in Wire Ropes by Combining Structure and Appearance"
//! (cited as [Wacker13]): numbers and images in, numbers and images out.

pub mod aligner;
pub mod appearance;
pub mod camera;
pub mod camera_distance;
pub mod contour;
pub mod defects;
pub mod displacement;
pub mod estimates;
pub mod evidence;
pub mod histogram;
pub mod image;
mod lock;
pub mod model_contour;
pub mod registration;
pub mod render;
pub mod rope;
pub mod scoring;
pub mod simplex;
pub mod smoothing;
pub mod strand;
pub mod strand_alignment;
pub mod stretch;
pub mod surface;
pub mod surface_map;
pub mod synthesis;
pub mod template;
pub mod threshold;
pub mod unwrapping;
pub mod wire;
pub mod wire_alignment;
pub mod wire_pattern;
pub mod wire_tracking;
