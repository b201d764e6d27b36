//! `ropescope inspect`.

/// Measures lay lengths and finds defects.
#[derive(clap::Args)]
pub(crate) struct InspectArgs {}

/// Runs the command.
pub(crate) fn run(_args: InspectArgs) -> anyhow::Result<()> {
    anyhow::bail!("inspect is being written")
}
