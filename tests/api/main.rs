//! The service over real HTTP, each test with its own data folder and port.

mod access;
mod acquisitions;
mod contract;
mod crash;
mod frames;
mod helpers;
mod jobs;
mod leases;
mod results;
mod ropes;
