//! `ropescope healthcheck`: a probe for containers, which have no curl.

use anyhow::{Context, bail};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Longest answer time.
const TIMEOUT: Duration = Duration::from_secs(3);

/// Asks a service on this machine whether it is ready; exit code 0 if it is.
#[derive(clap::Args)]
pub(crate) struct HealthcheckArgs {
    /// Where it listens
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    address: SocketAddr,
}

/// Runs the command.
pub(crate) fn run(args: HealthcheckArgs) -> anyhow::Result<()> {
    let address = args.address;
    let mut stream = TcpStream::connect_timeout(&address, TIMEOUT).with_context(|| format!("nobody at {address}"))?;
    stream.set_read_timeout(Some(TIMEOUT))?;
    write!(stream, "GET /readyz HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")?;
    let mut answer = String::new();
    stream.take(4096).read_to_string(&mut answer).context("no answer")?;
    let status = answer.split_whitespace().nth(1).unwrap_or_default();
    if status != "200" {
        bail!("the service at {address} is not ready: it answered {status:?}");
    }
    println!("ready");
    Ok(())
}
