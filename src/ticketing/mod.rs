//! One ticket per defect: carries the events of the outbox to the maintenance system as signed webhooks.
//!
//! `event` says what is sent, `schedule` when it is tried again, `guard` where it may go, `send` makes one attempt,
//! `dispatcher` is the loop over all of them. State is in the database only: a process that dies mid-attempt leaves a lease
//! that ends, and the receiver may see the same `webhook-id` twice, never two of them for one defect.

pub mod dispatcher;
pub mod event;
pub mod guard;
pub mod schedule;
pub mod send;

pub use dispatcher::{Dispatcher, Settings};
