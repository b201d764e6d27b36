//! The service over HTTP.
//!
//! [`router`] shows every route and who may use it. One file a resource; [`problem`] is the one error type, [`extract`] the
//! one way requests are read, [`guard`] stands before every route, [`server`] accepts connections.

pub mod acquisitions;
pub mod auth;
pub mod deliveries;
pub mod extract;
pub mod frames;
pub mod guard;
pub mod health;
pub mod openapi;
pub mod pages;
pub mod problem;
pub mod ropes;
pub mod ropeways;
pub mod router;
pub mod server;
pub mod times;
pub mod tokens;
mod upload;
pub mod webhooks;

pub use problem::Problem;
