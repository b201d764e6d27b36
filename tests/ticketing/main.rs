//! Confirmed defects reach a real HTTP receiver, once each, whatever the receiver does.

mod helpers;
mod once;
mod receivers;
