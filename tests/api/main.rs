//! The service over real HTTP, each test with its own data folder and port.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

mod access;
mod acquisitions;
mod app;
mod applied_thresholds;
mod archives;
mod card;
mod contract;
mod crash;
mod frames;
mod jobs;
mod leases;
mod live;
mod live_processes;
mod manifests;
mod previews;
#[path = "../shared/process.rs"]
mod process;
mod receipts;
mod results;
mod retention;
mod ropes;
mod simulated;
mod surface_alarms;
mod thresholds;
mod toy_engine;
mod training;
