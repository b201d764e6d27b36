//! `ropescope serve`.

/// Runs the inspection service.
#[derive(clap::Args)]
pub(crate) struct ServeArgs {}

/// Runs the command.
pub(crate) fn run(_args: ServeArgs) -> anyhow::Result<()> {
    anyhow::bail!("serve is being written")
}
