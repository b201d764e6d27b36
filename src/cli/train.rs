//! `ropescope train`.

/// Learns the appearance of intact rope.
#[derive(clap::Args)]
pub(crate) struct TrainArgs {}

/// Runs the command.
pub(crate) fn run(_args: TrainArgs) -> anyhow::Result<()> {
    anyhow::bail!("train is being written")
}
