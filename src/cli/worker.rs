//! `ropescope worker`.

/// Runs workers only, on the same data folder as a service.
#[derive(clap::Args)]
pub(crate) struct WorkerArgs {}

/// Runs the command.
pub(crate) fn run(_args: WorkerArgs) -> anyhow::Result<()> {
    anyhow::bail!("worker is being written")
}
