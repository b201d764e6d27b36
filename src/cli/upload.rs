//! `ropescope upload`.

use crate::cli::upload_progress::{Form, Watcher};
use anyhow::Context;
use ropescope::upload::client::SILENCE;
use ropescope::upload::{Client, Names, Options, Plan, UploadError, Watching, receipt, upload, watch};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

const EXIT_CODES: &str = "\
Frames are frame_000000.png, frame_000001.png, ... (png, tif, tiff; bmp and raw dumps are converted without loss). The file
.ropescope-upload.jsonl in the folder remembers digests; it may be deleted at any time.

Exit codes, for scripts:
  0  complete: the service holds every frame
  1  the folder cannot be uploaded, or anything that is not below
  2  wrong arguments
  3  no link, or the service was not able to answer, for --patience-s: run the same command again
  4  the token is not valid or its role does not suffice
  5  the service has no room (disk or quota): make room there, then run the same command again
  6  the service refuses this recording: what it says must be settled by a person
  130  stopped by Ctrl-C: run the same command again to continue";

/// Uploads an acquisition folder to a service. Interrupted? Run it again: only what is missing is sent.
#[derive(clap::Args)]
#[command(after_help = EXIT_CODES)]
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
    /// Most frames on their way at the same time; fewer are when the link bears no more
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=32))]
    connections: u8,
    /// Most Mbit/s that are sent, so that others can use the link, too
    #[arg(long, value_name = "MBIT/S", value_parser = positive)]
    limit_mbit: Option<f64>,
    /// How long one request is repeated while the link or the service is down, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 600)]
    patience_s: u64,
    /// A connection on which nothing moves is given up after so many seconds
    #[arg(long, value_name = "SECONDS", default_value_t = SILENCE.as_secs(), value_parser = clap::value_parser!(u64).range(1..=600))]
    silence_s: u64,
    /// The recording is still being made: send frames as they come, complete it when it has rested for --rests-s
    #[arg(long)]
    watch: bool,
    /// With --watch: the recording has ended when nothing was added for so long, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 300, requires = "watch")]
    rests_s: u64,
    /// With --watch: the last frame of a view is whole when its file did not change for so long, in seconds; every other frame
    /// is whole when its successor exists
    #[arg(long, value_name = "SECONDS", default_value_t = 10, requires = "watch")]
    frame_rests_s: u64,
    /// Send a reduced form of all frames first (3 % of the bytes): lay lengths and coverage are known when it is there. The frames
    /// follow in the order in which the service wants them, suspicious metres first. With --watch, previews of new frames go before the
    /// frames that still wait
    #[arg(long)]
    preview_first: bool,
    /// Compress frames without loss before they are sent; pays where the link is slower than about 100 Mbit/s
    #[arg(long)]
    compress: bool,
    /// Bits of a gray value in raw dumps: 8, or 16 (little-endian); their width is sensor_px of rope.json
    #[arg(long, value_name = "BITS", default_value = "8", value_parser = ["8", "16"])]
    raw_bits: String,
    /// Wait until the service has read every frame back from its disk, and write its signed receipt here: then the originals may
    /// be deleted (`ropescope verify-receipt`)
    #[arg(long, value_name = "FILE")]
    receipt: Option<PathBuf>,
    /// One JSON object a line, for scripts
    #[arg(long)]
    json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(mbit) if mbit > 0.0 && mbit <= 1e5 => Ok(mbit),
        _ => Err("must be a number above 0 and at most 100000".into()),
    }
}

/// Runs the command.
pub(crate) fn run(args: UploadArgs) -> anyhow::Result<()> {
    let names = Names { ropeway: args.ropeway, rope: args.rope };
    let watcher = Arc::new(Watcher::new(Form::choose(args.json)));
    let patience = Duration::from_secs(args.patience_s);
    let mut client = Client::new(&args.server, &args.token, patience, rand::random())?;
    if let Some(mbit) = args.limit_mbit {
        client = client.limited_to(mbit * 1e6 / 8.0);
    }
    let told = Arc::clone(&watcher);
    let client =
        client.patient_for(Duration::from_secs(args.silence_s)).telling(move |last, wait| told.waiting(last, wait));
    let options = Options {
        connections: args.connections.into(),
        raw_bits: if args.raw_bits == "16" { 16 } else { 8 },
        compress: args.compress,
        receipt: args.receipt.is_some(),
        preview_first: args.preview_first,
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let on_tick = |tick: &_| watcher.tick(tick);
    let report = runtime.block_on(async {
        if args.watch {
            let watching = Watching {
                frame_rests: Duration::from_secs(args.frame_rests_s),
                recording_rests: Duration::from_secs(args.rests_s),
            };
            watch(&client, &args.folder, &names, &options, watching, on_tick).await
        } else {
            upload(&client, &Plan::read(&args.folder, &names)?, &options, on_tick).await
        }
    });
    let report = report.with_context(|| {
        format!(
            "{} is not uploaded completely; what was sent stays sent, run the same command again to continue",
            args.folder.display()
        )
    })?;
    if let (Some(path), Some(receipt)) = (&args.receipt, &report.receipt) {
        receipt::write(receipt, path).with_context(|| format!("cannot write {}", path.display()))?;
    }
    watcher.done(&report);
    Ok(())
}

/// The exit code of a failed upload; `None` if the error is none of an upload's.
pub(crate) fn exit_code(error: &anyhow::Error) -> Option<u8> {
    let error = match error.downcast_ref::<UploadError>()? {
        UploadError::Client(error) => error,
        UploadError::OtherDesign { .. } => return Some(6),
        _ => return None,
    };
    Some(match error.status() {
        Some(401 | 403) => 4,
        Some(507) => 5,
        Some(400..=499) => 6,
        None if !error.is_unreachable() => 1,
        _ => 3,
    })
}
