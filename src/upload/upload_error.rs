//! Why uploads end early.

use super::client::ClientError;
use super::plan::PlanError;
use serde_json::Value;

/// Why an upload ended early. What was sent stays sent: a rerun continues.
#[derive(Debug, thiserror::Error)]
pub enum UploadError {
    /// The folder cannot be uploaded.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The service did not play along.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The service knows the rope by other data.
    #[error(
        "the rope {rope:?} on ropeway {ropeway:?} has {quantity} {held} at the service, but rope.json says {ours}: correct rope.json, or give the rope another name with --rope"
    )]
    OtherDesign {
        /// Name of the ropeway.
        ropeway: String,
        /// Name of the rope.
        rope: String,
        /// What differs.
        quantity: &'static str,
        /// The value there.
        held: Value,
        /// The value here.
        ours: Value,
    },
    /// The frames that the service names as missing are not in the folder.
    #[error("the service misses view {view} frame {frame}, which is not in this folder")]
    UnknownFrame {
        /// The view.
        view: usize,
        /// The frame.
        frame: usize,
    },
}
