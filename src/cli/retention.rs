//! `ropescope retention`.

use ropescope::clock::{Clock, SystemClock};
use ropescope::store::Store;
use std::path::PathBuf;

/// Removes frames that are older than their ropeway keeps them (PUT /ropeways/{id}/storage); may run while the service does.
///
/// Results stay, and so does what is evidence of a defect that is open or confirmed, was never inspected with a model (without one, nobody has
/// looked for defects), or is being worked on. Previews of acquisitions that were never completed go after the same time.
#[derive(clap::Args)]
pub(crate) struct RetentionArgs {
    /// Data folder of the service
    #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
    data: PathBuf,
    /// Say what would be removed, and remove nothing
    #[arg(long)]
    dry_run: bool,
}

/// Runs the command.
pub(crate) fn run(args: &RetentionArgs) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let store = Store::open(&args.data).await?;
        let now_ms = SystemClock.now_ms();
        let (mut removed, mut bytes) = (0, 0);
        for one in store.overdue(now_ms).await? {
            let about = format!(
                "{}  {}, {}: {} frames, {:.1} GB, {} days old (kept for {})",
                one.id,
                one.ropeway,
                one.rope,
                one.frames,
                one.frame_bytes as f64 / 1e9,
                one.age_days,
                one.keep_days
            );
            if let Some(reason) = &one.kept_because {
                println!("stays    {about}: {reason}");
            } else if args.dry_run || store.remove_frames(one.id, now_ms).await? {
                println!("{}  {about}", if args.dry_run { "would go" } else { "removed " });
                removed += 1;
                bytes += one.frame_bytes;
            }
        }
        let (previews, preview_bytes) = store.remove_overdue_previews(now_ms, args.dry_run).await?;
        store.close().await;
        let verb = if args.dry_run { "would be removed" } else { "were removed" };
        println!("frames of {removed} acquisitions ({:.1} GB) {verb}", bytes as f64 / 1e9);
        if previews > 0 {
            println!(
                "{previews} previews ({:.2} GB) of acquisitions that were never completed {verb}",
                preview_bytes as f64 / 1e9
            );
        }
        Ok(())
    })
}
