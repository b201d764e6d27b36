//! `ropescope verify-receipt`.

use anyhow::{Context, bail};
use ropescope::signature;
use ropescope::store::digest;
use ropescope::upload::{Names, Plan};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Checks a receipt (or a coverage certificate): who signed it, that nothing was changed, and that it is about a folder.
///
/// Exit code 0: it holds. 1: it does not, or it is about other frames; keep the originals.
#[derive(clap::Args)]
pub(crate) struct VerifyReceiptArgs {
    /// The receipt, as `ropescope upload --receipt` wrote it
    receipt: PathBuf,
    /// Public key of the service (`x` of GET /api/v1/signing-key); without it, the key in the receipt is shown for comparison
    // One key of 64 begins with a hyphen: base64url has it as a digit.
    #[arg(long, value_name = "KEY", allow_hyphen_values = true)]
    key: Option<String>,
    /// The folder with the originals: must hold exactly the frames of the receipt (of those that were sent as they are)
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &VerifyReceiptArgs) -> anyhow::Result<()> {
    let name = args.receipt.display();
    let bytes = std::fs::read(&args.receipt).with_context(|| format!("cannot read {name}"))?;
    let signed: Value = serde_json::from_slice(&bytes).with_context(|| format!("{name} is not JSON"))?;
    let (document, key) =
        signature::verify(&signed, args.key.as_deref()).with_context(|| format!("{name} does not hold"))?;
    if let Some(folder) = &args.folder {
        let ours = manifest_digest(folder)?;
        if document["manifest_sha256"] != ours {
            bail!(
                "{name} holds, but is about other frames than {}: manifest {} there, {ours} here; keep the originals",
                folder.display(),
                document["manifest_sha256"]
            );
        }
    }
    println!("{}", serde_json::to_string_pretty(&document)?);
    println!(
        "signed with {key}{}",
        if args.key.is_some() { ", as expected" } else { "; is that the key of your service?" }
    );
    Ok(())
}

/// The digest of all frames of a folder as they lie there.
fn manifest_digest(folder: &Path) -> anyhow::Result<String> {
    let plan = Plan::read(folder, &Names::default())?;
    let mut frames = Vec::with_capacity(plan.frame_count());
    for (view, of_view) in (0..).zip(&plan.frames) {
        for (number, frame) in (0..).zip(of_view) {
            frames.push((view, number, digest::of_file(&frame.path)?, frame.bytes));
        }
    }
    Ok(digest::of_manifest(frames.iter().map(|(view, number, sha256, bytes)| (*view, *number, &**sha256, *bytes))))
}

#[cfg(test)]
mod tests {
    use super::VerifyReceiptArgs;
    use clap::Args;

    #[test]
    fn a_key_that_begins_with_a_hyphen_is_a_key() {
        let command = VerifyReceiptArgs::augment_args(clap::Command::new("verify-receipt"));
        let read = command.try_get_matches_from(["verify-receipt", "receipt.json", "--key", "-Zk_1", "--folder", "d"]);
        assert_eq!(read.unwrap().get_one::<String>("key").map(String::as_str), Some("-Zk_1"));
    }
}
