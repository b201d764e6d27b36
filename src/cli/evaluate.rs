//! `ropescope evaluate`.

/// Scores results against truth.
#[derive(clap::Args)]
pub(crate) struct EvaluateArgs {}

/// Runs the command.
pub(crate) fn run(_args: EvaluateArgs) -> anyhow::Result<()> {
    anyhow::bail!("evaluate is being written")
}
