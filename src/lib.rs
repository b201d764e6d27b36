//! Ropescope inspects stranded wire ropes with line cameras: it aligns a 3-D rope model with the images, reads the lay lengths
//! of strands and wires, learns how intact rope looks and flags what does not look so.
//!
//! `vision` is the paper, `pipeline` drives it, `store`, `workers` and `http` make a service of it.

pub mod app; // what handlers and workers share
pub mod clock; // time as an argument
pub mod config; // every setting
pub mod drawing; // pictures for people
pub mod evaluate; // results against truth
pub mod experiments; // the paper's experiments, run whole and written down
pub mod http; // the API
pub mod pipeline; // vision over a whole acquisition
pub mod service; // all of that as one process
pub mod signature; // documents that can be shown years later
pub mod simulate; // ropes with known truth
pub mod store; // SQLite and files
pub mod ticketing; // one ticket per defect
pub mod tls; // cryptography of outgoing connections
pub mod upload; // the laptop's client
pub mod vision; // the paper: pure numbers and images
pub mod workers; // jobs
