//! `ropescope backup` and `ropescope restore`.

use anyhow::{Context, ensure};
use ropescope::store::Store;
use ropescope::store::backup::Copied;
use std::path::{Path, PathBuf};

/// Copies a data folder while it is being served; run it again on the same copy to bring that up to date.
///
/// The copy is a data folder itself, tokens and signing key included: keep it as safe as the original. Exit code 1 when something
/// was damaged before it could be copied; everything else is copied then, too.
#[derive(clap::Args)]
pub(crate) struct BackupArgs {
    /// Data folder of the service
    #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
    data: PathBuf,
    /// Where the copy lies, better on another disk
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

/// Makes a data folder from a backup, with every digest verified.
#[derive(clap::Args)]
pub(crate) struct RestoreArgs {
    /// The backup
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
    /// The data folder to be made; must not exist yet, or be empty
    #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
    data: PathBuf,
}

/// Runs `backup`.
pub(crate) fn backup(args: &BackupArgs) -> anyhow::Result<()> {
    copy(&args.data, &args.to)
}

/// Runs `restore`.
pub(crate) fn restore(args: &RestoreArgs) -> anyhow::Result<()> {
    let empty = std::fs::read_dir(&args.data).map_or(true, |mut entries| entries.next().is_none());
    ensure!(empty, "{} is not empty: restore into a new folder, then serve that", args.data.display());
    copy(&args.from, &args.data)
}

fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    ensure!(from.join("ropescope.db").is_file(), "{} is no data folder: it has no ropescope.db", from.display());
    std::fs::create_dir_all(to).with_context(|| format!("cannot make {}", to.display()))?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let Copied { copied, held, damaged } = runtime.block_on(async {
        let store = Store::open(from).await?;
        let copied = store.copy_to(to).await;
        store.close().await;
        copied
    })?;
    for path in &damaged {
        println!("damaged  {}", path.display());
    }
    println!("{copied} files and folders copied, {held} were there, {} are damaged", damaged.len());
    ensure!(
        damaged.is_empty(),
        "{} files are lost or not what they were; `ropescope scrub` marks frames so that they are asked for again",
        damaged.len()
    );
    Ok(())
}
