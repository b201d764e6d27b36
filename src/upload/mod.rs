//! The laptop's client: brings an acquisition folder to a service, again and again until all of it is there.
//!
//! `plan` reads the folder and chooses ids, `packing` brings frames into the stored form, `journal` remembers digests, `client`
//! speaks HTTP and keeps trying, `pace` and `lanes` fit it to the link, `place` finds ropeway and rope, `transfer` announces, sends
//! and completes (`entries` one by one, `missing` after them, `previews` and `reducing` before), `watch` does so while the recording grows, `receipt`
//! waits until the originals may be deleted. Ids are derived from names and content, so a rerun finds what an
//! earlier run began and sends only the rest.

pub mod client;
mod client_error;
mod entries;
pub mod ids;
pub mod journal;
pub mod lanes;
mod missing;
pub mod pace;
pub mod packing;
pub mod place;
pub mod plan;
mod previews;
pub mod progress;
pub mod receipt;
pub mod reducing;
pub mod transfer;
mod upload_error;
pub mod watch;

pub use client::{Client, ClientError};
pub use plan::{Names, Plan, PlanError};
pub use progress::{Stage, Tick, ViewTick};
pub use transfer::{Options, Report, upload};
pub use upload_error::UploadError;
pub use watch::{Watching, watch};
