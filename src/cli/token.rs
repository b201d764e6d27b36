//! `ropescope token`.

/// Makes access tokens.
#[derive(clap::Args)]
pub(crate) struct TokenArgs {}

/// Runs the command.
pub(crate) fn run(_args: TokenArgs) -> anyhow::Result<()> {
    anyhow::bail!("token is being written")
}
