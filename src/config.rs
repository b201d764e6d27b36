//! Every setting of the service, with unit, default and allowed interval. Read once, from the command line or its environment.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

/// Settings of a process that serves or works.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The data folder.
    pub data: PathBuf,
    /// Where to listen; port 0 takes a free one.
    pub listen: SocketAddr,
    /// How the world reaches the service, without a slash at the end; for links in tickets. `None`: `http://` and the address.
    pub public_url: Option<String>,
    /// Jobs on complete acquisitions that run at once in this process, 0..=16; with 0, no live ones do either.
    pub workers: usize,
    /// Jobs on open acquisitions.
    pub live: LiveSettings,
    /// Bounds on what clients may ask.
    pub limits: Limits,
    /// How jobs are leased.
    pub lease: LeaseSettings,
}

impl Settings {
    /// Defaults for a data folder: loopback, port 8080, one worker.
    pub fn new(data: impl Into<PathBuf>) -> Self {
        Self {
            data: data.into(),
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 8080)),
            public_url: None,
            workers: 1,
            live: LiveSettings::default(),
            limits: Limits::default(),
            lease: LeaseSettings::default(),
        }
    }
}

/// Bounds on what clients may ask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Longest frame file in bytes. 64 MiB holds 65,536 lines of 1,024 px uncompressed.
    pub frame_bytes: u64,
    /// Bytes of the disk that uploads leave free, for jobs and the database.
    pub reserve_bytes: u64,
    /// Longest JSON body in bytes.
    pub json_bytes: usize,
    /// Open connections.
    pub connections: usize,
    /// Requests worked on at once; more get 503.
    pub requests: usize,
    /// Frames received at once; more wait, then get 503.
    pub uploads: usize,
    /// Decodings and renderings at once: each takes a core and up to 200 MB.
    pub cpu: usize,
    /// Time a client has for the header of a request.
    pub header_timeout: Duration,
    /// Time between two pieces of a body.
    pub body_gap: Duration,
    /// Time for a request that is neither upload nor event stream.
    pub request_timeout: Duration,
    /// Time for one upload.
    pub upload_timeout: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            frame_bytes: 64 << 20,
            reserve_bytes: 1_000_000_000,
            json_bytes: 256 << 10,
            connections: 512,
            requests: 256,
            uploads: 16,
            cpu: std::thread::available_parallelism().map_or(2, usize::from).min(8),
            header_timeout: Duration::from_secs(15),
            body_gap: Duration::from_secs(30),
            request_timeout: Duration::from_secs(60),
            upload_timeout: Duration::from_secs(15 * 60),
        }
    }
}

/// How jobs on open acquisitions wait for their frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiveSettings {
    /// Such jobs at once in this process, beside the others: each keeps up to 200 MB while it waits.
    pub jobs: usize,
    /// A job ends when no frame of its acquisition came for longer.
    pub patience: Duration,
}

impl Default for LiveSettings {
    fn default() -> Self {
        Self { jobs: 4, patience: Duration::from_secs(3 * 24 * 3600) }
    }
}

/// How jobs are leased.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeaseSettings {
    /// A worker that is silent for longer has lost its job.
    pub duration: Duration,
    /// Time between heartbeats, each of which records progress and learns of cancellation.
    pub heartbeat: Duration,
    /// Longest time between two looks for a job; a job of this process is seen at once.
    pub poll: Duration,
}

impl Default for LeaseSettings {
    fn default() -> Self {
        Self { duration: Duration::from_secs(15), heartbeat: Duration::from_secs(1), poll: Duration::from_secs(2) }
    }
}
