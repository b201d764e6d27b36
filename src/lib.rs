//! Ropescope inspects stranded wire ropes with line cameras: it aligns a 3-D rope model with the images, reads the lay lengths
//! of strands and wires, learns how intact rope looks and flags what does not look so.
//!
//! Modules in reading order.

pub mod clock; // time as an argument
pub mod evaluate; // results against truth
pub mod http; // the service
pub mod pipeline; // vision over a whole acquisition
pub mod simulate; // ropes with known truth
pub mod store; // SQLite and blobs
pub mod ticketing; // one ticket per defect
pub mod tls; // cryptography of outgoing connections
pub mod upload;
pub mod vision; // the paper: pure numbers and images
pub mod workers; // jobs // the laptop's client
