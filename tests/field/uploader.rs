//! The laptop's client as a process of its own.

use crate::process::PROGRAM;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A port that was free a moment ago: a service that is started again must have the address it had.
pub fn free_port() -> u16 {
    std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// `ropescope upload --json`, killed when dropped; what it says is kept.
pub struct Uploader {
    child: Child,
    said: Arc<Mutex<Vec<Value>>>,
    reader: Option<JoinHandle<()>>,
}

impl Uploader {
    pub fn start(folder: &Path, server: &str, token: &str, more: &[&str]) -> Self {
        let mut child = Command::new(PROGRAM)
            .arg("upload")
            .arg(folder)
            .args(["--json", "--server", server])
            .args(more)
            .env("ROPESCOPE_TOKEN", token)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let said = Arc::new(Mutex::new(Vec::new()));
        let (lines, kept) = (BufReader::new(child.stdout.take().unwrap()).lines(), said.clone());
        let reader = std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                kept.lock().unwrap().push(serde_json::from_str(&line).unwrap());
            }
        });
        Self { child, said, reader: Some(reader) }
    }

    /// Everything it said until now.
    pub fn said(&self) -> Vec<Value> {
        self.said.lock().unwrap().clone()
    }

    /// Frames of which it knows that the service holds them.
    pub fn held(&self) -> u64 {
        self.said.lock().unwrap().iter().rev().find_map(|line| line["held"].as_u64()).unwrap_or(0)
    }

    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    pub fn running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// Waits for its end; returns how it ended and what it said on stderr.
    pub fn ended(&mut self, within: Duration) -> (ExitStatus, String) {
        let begun = Instant::now();
        while self.running() {
            assert!(begun.elapsed() < within, "it does not end: {:?}", self.said().last());
            std::thread::sleep(Duration::from_millis(20));
        }
        let mut error = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut error).unwrap();
        if let Some(reader) = self.reader.take() {
            reader.join().unwrap();
        }
        (self.child.wait().unwrap(), error)
    }

    /// Waits for its good end; returns its report.
    pub fn report(&mut self, within: Duration) -> Value {
        let (status, error) = self.ended(within);
        assert!(status.success(), "{status}: {error}");
        let report = self.said().last().unwrap().clone();
        assert_eq!(report["event"], "done", "{report}");
        report
    }
}

impl Drop for Uploader {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
