//! Digests of what lies on the disk.

use super::StoreError;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes that are read at once.
const PIECE: usize = 256 << 10;

/// Lower-case hex.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// One digest for many frames (view, number, digest, length): the SHA-256 of a line `view frame sha256 bytes` for each.
pub fn of_manifest<'a>(frames: impl Iterator<Item = (u32, u32, &'a str, u64)>) -> String {
    let mut hash = Sha256::new();
    for (view, frame, sha256, bytes) in frames {
        hash.update(format!("{view} {frame} {sha256} {bytes}\n"));
    }
    hex(&hash.finalize())
}

/// SHA-256 of a file as its disk has it, not as the system remembers it from writing, lower-case hex.
pub fn of_file_on_disk(path: &Path) -> Result<String, StoreError> {
    #[cfg(target_os = "linux")]
    if let Ok(file) = File::open(path) {
        // Only clean pages are forgotten, and frames were synced; where it fails, the memory is as good as it gets.
        let _ = rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed);
    }
    of_file(path)
}

/// SHA-256 of a file as it lies there now, lower-case hex.
pub fn of_file(path: &Path) -> Result<String, StoreError> {
    let failed = |source| StoreError::File { path: path.into(), source };
    let mut file = File::open(path).map_err(failed)?;
    let mut hash = Sha256::new();
    let mut piece = vec![0; PIECE];
    loop {
        match file.read(&mut piece).map_err(failed)? {
            0 => return Ok(hex(&hash.finalize())),
            n => hash.update(&piece[..n]),
        }
    }
}
