//! What a report says of how it was made, and errors of experiments as the command line knows them.

use ropescope::clock::{Clock, SystemClock};
use ropescope::experiments::{ExperimentError, Provenance};

/// The command line that this is, and today's date.
pub(super) fn now() -> Provenance {
    let arguments = std::env::args().skip(1);
    let command = std::iter::once("ropescope".to_owned()).chain(arguments).collect::<Vec<_>>().join(" ");
    let today = jiff::Timestamp::from_millisecond(SystemClock.now_ms()).unwrap_or_default();
    Provenance { command, date: today.strftime("%Y-%m-%d").to_string() }
}

/// A run that was stopped is told as every stopped run is.
pub(super) fn told(error: ExperimentError) -> anyhow::Error {
    match error {
        ExperimentError::Pipeline(error) => error.into(),
        other => other.into(),
    }
}
