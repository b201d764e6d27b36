//! `ropescope demo`.

/// Shows the whole service on a simulated rope.
#[derive(clap::Args)]
pub(crate) struct DemoArgs {}

/// Runs the command.
pub(crate) fn run(_args: DemoArgs) -> anyhow::Result<()> {
    anyhow::bail!("demo is being written")
}
