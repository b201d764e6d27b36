//! The program as a process of its own, for every test that kills it or looks at it from outside.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// The program.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_ropescope");

/// `ropescope serve` or `worker`, killed when dropped.
pub struct Process {
    pub child: Child,
    pub base: String,
}

impl Process {
    /// Starts a service on a port (0: a free one) and waits until it listens.
    pub fn serve(data: &Path, port: u16, more: &[&str]) -> Self {
        let address = format!("127.0.0.1:{port}");
        Self::begin(&[&["serve", "--listen", &address], more].concat(), data)
    }

    /// Starts a command on a data folder and waits until it says where it works.
    pub fn begin(command: &[&str], data: &Path) -> Self {
        let mut child = Command::new(PROGRAM)
            .args(command)
            .arg("--data")
            .arg(data)
            .env("RUST_LOG", "warn")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said = line.trim().strip_prefix("listening on ").or(line.trim().strip_prefix("working on "));
        let base = said.unwrap_or_else(|| panic!("{line:?}")).to_owned();
        Self { child, base }
    }

    /// SIGKILL: no handler runs, nothing is flushed.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A token of the administrator.
pub fn token(data: &Path) -> String {
    let made = Command::new(PROGRAM).args(["token", "create", "--role", "admin", "--data"]).arg(data).output().unwrap();
    assert!(made.status.success(), "{made:?}");
    String::from_utf8(made.stdout).unwrap().lines().last().unwrap().to_owned()
}
