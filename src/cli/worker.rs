//! `ropescope worker`.

use super::live::LiveArgs;
use super::logs;
use ropescope::config::Settings;
use ropescope::service::{self, Service};
use std::path::PathBuf;

/// Runs workers only, on the same data folder as a service.
#[derive(clap::Args)]
pub(crate) struct WorkerArgs {
    /// Data folder of the service
    #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
    data: PathBuf,
    /// Jobs that run at once in this process
    #[arg(long, env = "ROPESCOPE_WORKERS", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=16))]
    workers: u8,
    #[command(flatten)]
    live: LiveArgs,
}

/// Runs the command.
pub(crate) fn run(args: WorkerArgs) -> anyhow::Result<()> {
    logs::start();
    let settings =
        Settings { workers: usize::from(args.workers), live: args.live.settings(), ..Settings::new(args.data) };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        let service = Service::start_workers(settings).await?;
        println!("working on {}", service.app.settings.data.display());
        service::signal().await;
        tracing::info!("going down");
        service.stop().await;
        Ok(())
    })
}
