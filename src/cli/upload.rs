//! `ropescope upload`.

/// Uploads an acquisition folder to a service.
#[derive(clap::Args)]
pub(crate) struct UploadArgs {}

/// Runs the command.
pub(crate) fn run(_args: UploadArgs) -> anyhow::Result<()> {
    anyhow::bail!("upload is being written")
}
