//! `ropescope upload`.

use crate::cli::upload_progress::{Form, Watcher};
use anyhow::Context;
use ropescope::upload::{Client, Names, Options, Plan, upload};
use std::path::PathBuf;
use std::time::Duration;

/// Uploads an acquisition folder to a service. Interrupted? Run it again: only what is missing is sent.
#[derive(clap::Args)]
pub(crate) struct UploadArgs {
    /// Folder with rope.json and the frames of every view
    folder: PathBuf,
    /// Address of the service, such as http://127.0.0.1:8080
    #[arg(long, value_name = "URL", env = "ROPESCOPE_SERVER")]
    server: String,
    /// Access token (`ropescope token create`); better given as ROPESCOPE_TOKEN, which other users of the machine cannot see
    #[arg(long, env = "ROPESCOPE_TOKEN", hide_env_values = true)]
    token: String,
    /// Name of the ropeway, instead of the one in rope.json
    #[arg(long, value_name = "NAME")]
    ropeway: Option<String>,
    /// Name of the rope, instead of the one in rope.json
    #[arg(long, value_name = "NAME")]
    rope: Option<String>,
    /// Frames on their way at the same time
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=32))]
    connections: u8,
    /// How long one request is repeated while the link or the service is down, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 600)]
    patience_s: u64,
    /// One JSON object a line, for scripts
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub(crate) fn run(args: UploadArgs) -> anyhow::Result<()> {
    let names = Names { ropeway: args.ropeway, rope: args.rope };
    let plan =
        Plan::read(&args.folder, &names).with_context(|| format!("{} cannot be uploaded", args.folder.display()))?;
    let client = Client::new(&args.server, &args.token, Duration::from_secs(args.patience_s), rand::random())?;
    let watcher = Watcher::new(Form::choose(args.json));
    let options = Options { connections: args.connections.into() };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let report = runtime
        .block_on(upload(&client, &plan, &options, |tick| watcher.tick(tick)))
        .context("the upload is not complete; what was sent stays sent, run the same command again to continue")?;
    watcher.done(&plan, &report);
    Ok(())
}
