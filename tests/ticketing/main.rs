//! Confirmed defects reach a real HTTP receiver, once each, whatever the receiver does.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says where")]

mod house;
mod once;
mod receivers;
