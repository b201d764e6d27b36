//! The service over HTTP.
//!
//! [`router`] shows every route and who may use it. One file a resource; [`problem`] is the one error type, [`extract`] the
//! one way requests are read, [`guard`] stands before every route, [`server`] accepts connections.

mod acquisition_body;
pub mod acquisitions;
mod archive_entries;
pub mod arrivals;
pub mod auth;
pub mod bandwidths;
pub mod buckets;
pub mod budgets;
pub mod completion;
pub mod defect;
pub mod defect_card;
pub mod defects;
pub mod deliveries;
pub mod diameter_summary;
pub mod extract;
pub mod frames;
mod further_acquisitions;
pub mod guard;
pub mod health;
pub mod history;
pub mod inspection_thresholds;
pub mod inspections;
pub mod job;
pub mod job_events;
pub mod jobs;
pub mod lay_lengths;
pub mod line_scores;
pub mod lines;
pub mod manifest;
pub mod model_fit;
pub mod models;
pub mod openapi;
pub mod pages;
pub mod picture;
pub mod pictures;
pub mod previews;
pub mod problem;
pub mod provisional;
mod raw_dump;
pub mod receipts;
pub mod rope_windows;
pub mod ropes;
pub mod ropeways;
pub mod router;
pub mod server;
mod space;
pub mod suggestion;
pub mod surface_alarms;
pub mod tables;
pub mod threshold_preview;
pub mod threshold_wish;
pub mod thresholds;
pub mod tickets;
pub mod times;
pub mod tokens;
pub mod tus;
mod tus_chunk;
pub mod unpack;
mod upload;
pub mod verdicts;
pub mod wanted;
pub mod webhooks;

pub use problem::Problem;
