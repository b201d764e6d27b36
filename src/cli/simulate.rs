//! `ropescope simulate`.

/// Writes a synthetic acquisition with known truth.
#[derive(clap::Args)]
pub(crate) struct SimulateArgs {}

/// Runs the command.
pub(crate) fn run(_args: SimulateArgs) -> anyhow::Result<()> {
    anyhow::bail!("simulate is being written")
}
