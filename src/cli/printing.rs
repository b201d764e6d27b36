//! What commands print as their result.

use std::fmt::Display;
use std::io::{ErrorKind, Write};

/// Prints to standard output. A reader that has had enough of it, as `head` has, is no failure: what was to be made is made.
pub(super) fn print_result(result: impl Display) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match write!(out, "{result}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        printed => Ok(printed?),
    }
}
