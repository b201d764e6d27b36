//! Uploads that survive the mountain: real processes, killed and cut off at random (seeded) moments.
//!
//! Tests that are ignored run the same with the full figures, or need root; `cargo test --test field -- --include-ignored` runs all.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

mod archives;
mod disk;
mod endings;
mod growing;
mod housekeeping;
mod kills;
mod link;
mod previews;
#[path = "../shared/process.rs"]
mod process;
mod proxy;
mod recording;
mod uploader;
