//! Options of processes that run jobs on acquisitions which are still arriving.

use ropescope::config::LiveSettings;
use std::time::Duration;

/// How jobs on open acquisitions wait for their frames.
#[derive(clap::Args)]
pub(super) struct LiveArgs {
    /// Jobs on acquisitions that are still arriving that run at once in this process, beside the others
    #[arg(long, env = "ROPESCOPE_LIVE_JOBS", default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=16))]
    live_jobs: u8,
    /// Hours without a new frame after which such a job ends
    #[arg(long, env = "ROPESCOPE_LIVE_PATIENCE_H", default_value_t = 72, value_name = "H", value_parser = clap::value_parser!(u32).range(1..))]
    live_patience_h: u32,
}

impl LiveArgs {
    /// As the process takes them.
    pub fn settings(&self) -> LiveSettings {
        let patience = Duration::from_secs(u64::from(self.live_patience_h) * 3600);
        LiveSettings { jobs: usize::from(self.live_jobs), patience }
    }
}
