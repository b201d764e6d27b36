//! `ropescope serve`.

use super::live::LiveArgs;
use super::logs;
use ropescope::config::{Limits, Settings};
use ropescope::service::{self, Service};
use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Runs the inspection service.
#[derive(clap::Args)]
pub(crate) struct ServeArgs {
    /// Folder for the database, frames, models and results
    #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
    data: PathBuf,
    /// Where to listen; port 0 takes a free one
    #[arg(long, env = "ROPESCOPE_LISTEN", default_value = "127.0.0.1:8080", value_name = "ADDR")]
    listen: SocketAddr,
    /// Jobs that run at once in this process
    #[arg(long, env = "ROPESCOPE_WORKERS", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=16))]
    workers: u8,
    /// Run no jobs here; `ropescope worker` does
    #[arg(long, conflicts_with = "workers")]
    no_workers: bool,
    /// How the world reaches the service, for links in tickets
    #[arg(long, env = "ROPESCOPE_PUBLIC_URL", value_name = "URL")]
    public_url: Option<String>,
    /// MB (10^6 bytes) of the disk that uploads leave free, for jobs and the database
    #[arg(long, env = "ROPESCOPE_RESERVE_MB", default_value_t = 1000, value_name = "MB")]
    reserve_mb: u32,
    #[command(flatten)]
    live: LiveArgs,
}

/// Runs the command.
pub(crate) fn run(args: ServeArgs) -> anyhow::Result<()> {
    logs::start();
    ropescope::tls::install();
    let limits = Limits { reserve_bytes: u64::from(args.reserve_mb) * 1_000_000, ..Limits::default() };
    let settings = Settings {
        limits,
        listen: args.listen,
        workers: if args.no_workers { 0 } else { usize::from(args.workers) },
        live: args.live.settings(),
        public_url: args.public_url,
        ..Settings::new(args.data)
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        let service = Service::start(settings).await?;
        let mut out = std::io::stdout();
        writeln!(out, "listening on {}", service.base_url())?;
        out.flush()?;
        tracing::info!(address = service.base_url(), data = %service.app.settings.data.display(), "ready");
        service::signal().await;
        tracing::info!("going down");
        service.stop().await;
        Ok(())
    })
}
