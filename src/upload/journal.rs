//! The journal beside the data: digests that were computed once, and under which id the acquisition was begun.
//!
//! What the service holds is not written here: only the service knows. A lost or read-only journal costs time, never data.

use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use uuid::Uuid;

/// Its name in the acquisition folder.
pub const FILE_NAME: &str = ".ropescope-upload.jsonl";

/// A frame as it will be sent.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Digested {
    /// Length of the file it comes from.
    pub source_bytes: u64,
    /// When that was last changed, ms since 1970.
    pub modified_ms: u64,
    /// How it is brought into the stored form; another way gives other bytes.
    pub packing: String,
    /// Digest of what is sent, lower-case hex.
    pub sha256: String,
    /// Length of what is sent.
    pub bytes: u64,
    /// Camera lines.
    pub lines: u32,
}

/// A line of the journal.
#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum Entry {
    Begun { begin: String, rope_id: Uuid, acquisition_id: Uuid },
    Frame { view: usize, frame: usize, digested: Digested },
}

/// The journal of one acquisition folder.
#[derive(Debug)]
pub struct Journal {
    begun: HashMap<(String, Uuid), Uuid>,
    frames: HashMap<(usize, usize), Digested>,
    file: Option<File>,
}

impl Journal {
    /// Opens the journal of a folder. Lines that cannot be read (the last one, when the laptop lost power) are skipped; a folder
    /// that cannot be written to has none.
    pub fn open(folder: &Path) -> Self {
        let path = folder.join(FILE_NAME);
        let text = std::fs::read(&path).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default();
        let mut journal = Self { begun: HashMap::new(), frames: HashMap::new(), file: None };
        for entry in text.lines().filter_map(|line| serde_json::from_str(line).ok()) {
            journal.learn(entry);
        }
        journal.file = OpenOptions::new().create(true).append(true).open(&path).ok();
        if journal.file.is_none() {
            tracing::debug!(path = %path.display(), "no journal: digests are computed anew in every run");
        }
        if !text.is_empty() && !text.ends_with('\n') {
            journal.append("\n"); // or the next line would be lost with the torn one
        }
        journal
    }

    fn learn(&mut self, entry: Entry) {
        match entry {
            Entry::Begun { begin, rope_id, acquisition_id } => {
                self.begun.insert((begin, rope_id), acquisition_id);
            }
            Entry::Frame { view, frame, digested } => {
                self.frames.insert((view, frame), digested);
            }
        }
    }

    /// Under which id this recording of this rope was begun before; else `id`, which is kept for the next run.
    pub fn acquisition_id(&mut self, begin: &str, rope_id: Uuid, id: impl FnOnce() -> Uuid) -> Uuid {
        if let Some(known) = self.begun.get(&(begin.to_owned(), rope_id)) {
            return *known;
        }
        let acquisition_id = id();
        self.write(Entry::Begun { begin: begin.to_owned(), rope_id, acquisition_id });
        acquisition_id
    }

    /// The digest of a frame, if its file and the way it is packed are as they were.
    pub fn digested(
        &self,
        view: usize,
        frame: usize,
        source_bytes: u64,
        modified_ms: u64,
        packing: &str,
    ) -> Option<&Digested> {
        let known =
            |d: &&Digested| (d.source_bytes, d.modified_ms, d.packing.as_str()) == (source_bytes, modified_ms, packing);
        self.frames.get(&(view, frame)).filter(known)
    }

    /// Keeps the digest of a frame.
    pub fn keep(&mut self, view: usize, frame: usize, digested: Digested) {
        self.write(Entry::Frame { view, frame, digested });
    }

    fn write(&mut self, entry: Entry) {
        if let Ok(line) = serde_json::to_string(&entry) {
            self.append(&format!("{line}\n"));
        }
        self.learn(entry);
    }

    /// One write a line: two clients on one folder do not tear each other's lines.
    fn append(&mut self, line: &str) {
        if let Some(file) = &mut self.file
            && let Err(error) = file.write_all(line.as_bytes())
        {
            tracing::debug!(%error, "the journal is not continued");
            self.file = None; // the laptop's disk is full, most likely: the upload goes on
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digested(sha256: &str) -> Digested {
        Digested { source_bytes: 7, modified_ms: 9, packing: "as is".into(), sha256: sha256.into(), bytes: 7, lines: 3 }
    }

    #[test]
    fn a_torn_last_line_costs_only_itself() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path());
        journal.keep(0, 0, digested("a"));
        journal.keep(0, 1, digested("b"));
        let path = folder.path().join(FILE_NAME);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 5]).unwrap();
        let mut journal = Journal::open(folder.path());
        assert_eq!(journal.digested(0, 1, 7, 9, "as is"), None);
        journal.keep(0, 2, digested("c"));
        let journal = Journal::open(folder.path());
        assert_eq!(journal.digested(0, 0, 7, 9, "as is"), Some(&digested("a")));
        assert_eq!(journal.digested(0, 2, 7, 9, "as is"), Some(&digested("c")));
    }

    #[test]
    fn a_changed_file_has_no_known_digest() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path());
        journal.keep(1, 4, digested("a"));
        assert_eq!(journal.digested(1, 4, 8, 9, "as is"), None);
        assert_eq!(journal.digested(1, 4, 7, 10, "as is"), None);
        assert_eq!(journal.digested(1, 4, 7, 9, "png"), None);
    }

    #[test]
    fn an_acquisition_keeps_the_id_under_which_it_was_begun() {
        let folder = tempfile::tempdir().unwrap();
        let (rope, id) = (Uuid::from_u128(1), Uuid::from_u128(2));
        assert_eq!(Journal::open(folder.path()).acquisition_id("x", rope, || id), id);
        let mut journal = Journal::open(folder.path());
        assert_eq!(journal.acquisition_id("x", rope, || Uuid::from_u128(3)), id);
        assert_eq!(journal.acquisition_id("y", rope, || Uuid::from_u128(4)), Uuid::from_u128(4));
    }
}
