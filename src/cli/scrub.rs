//! `ropescope scrub`.

use anyhow::ensure;
use ropescope::clock::{Clock, SystemClock};
use ropescope::store::Store;
use std::path::PathBuf;

/// Reads every stored frame and model back from the disk and compares digests; may run while the service does.
///
/// Damaged frames are marked: the service names them as missing, and `ropescope upload` sends them again. Exit code 1 when
/// anything is damaged.
#[derive(clap::Args)]
pub(crate) struct ScrubArgs {
    /// Data folder of the service
    #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
    data: PathBuf,
}

/// Runs the command.
pub(crate) fn run(args: &ScrubArgs) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let store = Store::open(&args.data).await?;
        let (mut frames, mut bytes, mut damaged) = (0, 0, 0);
        for acquisition in store.acquisition_ids().await? {
            let verified = store.verify_frames(acquisition, |_| {}).await?;
            store.mark_damaged(&verified.damaged, SystemClock.now_ms()).await?;
            for frame in &verified.damaged {
                println!("damaged  acquisition {acquisition} view {} frame {}", frame.view, frame.frame);
            }
            frames += verified.frames;
            bytes += verified.bytes;
            damaged += verified.damaged.len();
        }
        let models = store.damaged_models().await?;
        for model in &models {
            println!("damaged  model {model}: train it again");
        }
        damaged += models.len();
        store.close().await;
        println!("{frames} frames ({:.1} GB) read, {damaged} frames and models damaged", bytes as f64 / 1e9);
        ensure!(damaged == 0, "{damaged} stored frames and models are not what they were");
        Ok(())
    })
}
