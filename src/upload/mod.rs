//! The laptop's client: brings an acquisition folder to a service, again and again until all of it is there.
//!
//! `plan` reads the folder and chooses ids, `client` speaks HTTP and keeps trying, `transfer` sends what the service says is
//! missing. Ids are derived from names and content, so a rerun finds what an earlier run began and sends only the rest.

pub mod client;
pub mod ids;
pub mod plan;
pub mod transfer;

pub use client::{Client, ClientError};
pub use plan::{Names, Plan, PlanError};
pub use transfer::{Options, Report, Tick, UploadError, upload};
