//! Where `inspect` writes: into a folder of its own inside `--out`, put in place only when whole, so that a run which fails or is
//! cancelled leaves earlier results as they were.

use anyhow::{Context, bail};
use std::path::{Path, PathBuf};

/// Where results are made.
const PARTIAL: &str = ".ropescope-partial";
/// What results consist of. The summary last: a folder without it is not whole.
pub(crate) const RESULTS: [&str; 9] = [
    "lay_lengths.csv",
    "displacement.csv",
    "line_scores.csv",
    "maps",
    "defects.json",
    "look_again.json",
    "surface_alarms.csv",
    "cards",
    "summary.json",
];

/// Those that are folders, whose names others may use, too.
const FOLDERS: [&str; 2] = ["maps", "cards"];

/// A results folder that is being written.
pub(crate) struct ResultsOut {
    folder: PathBuf,
    partial: PathBuf,
    /// The folder did not exist before.
    made: bool,
    whole: bool,
}

impl ResultsOut {
    /// Prepares `--out`. Errors: it is a file, or holds something that is no earlier result and `force` is not given.
    pub(crate) fn prepare(folder: &Path, force: bool) -> anyhow::Result<Self> {
        let name = folder.display();
        if folder.exists() && !folder.is_dir() {
            bail!("--out {name} is a file, but results are a folder");
        }
        let earlier = folder.join(RESULTS[0]).exists() || folder.join(PARTIAL).exists();
        if let Some(taken) = FOLDERS.into_iter().find(|taken| !earlier && folder.join(taken).exists()) {
            bail!(
                "--out {name} holds a folder {taken} that is no earlier result and would be replaced: choose another folder"
            );
        }
        if !earlier && !force && folder.is_dir() {
            let mut entries = std::fs::read_dir(folder).with_context(|| format!("cannot read {name}"))?;
            if let Some(Ok(entry)) = entries.next() {
                bail!(
                    "--out {name} holds {} but no earlier results: choose another folder, or --force to write into it",
                    entry.file_name().display()
                );
            }
        }
        let made = !folder.exists();
        let partial = folder.join(PARTIAL);
        remove(&partial)?;
        std::fs::create_dir_all(&partial).with_context(|| format!("cannot make {}", partial.display()))?;
        Ok(Self { folder: folder.into(), partial, made, whole: false })
    }

    /// Where to write.
    pub(crate) fn partial(&self) -> &Path {
        &self.partial
    }

    /// Replaces earlier results by what was written.
    pub(crate) fn put_in_place(mut self) -> anyhow::Result<()> {
        for entry in RESULTS.iter().rev() {
            remove(&self.folder.join(entry))?;
        }
        for entry in RESULTS {
            let (from, to) = (self.partial.join(entry), self.folder.join(entry));
            if from.exists() {
                std::fs::rename(&from, &to).with_context(|| format!("cannot write {}", to.display()))?;
            }
        }
        self.whole = true;
        Ok(())
    }
}

impl Drop for ResultsOut {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.partial); // the next run removes it too
        if self.made && !self.whole {
            let _ = std::fs::remove_dir(&self.folder); // only if it is empty
        }
    }
}

fn remove(path: &Path) -> anyhow::Result<()> {
    let removed = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    match removed {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(e).with_context(|| format!("cannot replace {}", path.display()))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::ResultsOut;

    #[test]
    fn a_run_that_fails_leaves_what_was_there_and_one_that_ends_replaces_it() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("results");
        drop(ResultsOut::prepare(&out, false).unwrap());
        assert!(!out.exists());

        let run = ResultsOut::prepare(&out, false).unwrap();
        std::fs::write(run.partial().join("lay_lengths.csv"), "view\n").unwrap();
        std::fs::write(run.partial().join("defects.json"), "[]").unwrap();
        std::fs::write(run.partial().join("summary.json"), "1").unwrap();
        run.put_in_place().unwrap();

        let run = ResultsOut::prepare(&out, false).unwrap();
        std::fs::write(run.partial().join("lay_lengths.csv"), "view\n").unwrap();
        std::fs::write(run.partial().join("summary.json"), "2").unwrap();
        drop(run);
        assert_eq!(std::fs::read_to_string(out.join("summary.json")).unwrap(), "1");

        let run = ResultsOut::prepare(&out, false).unwrap();
        std::fs::write(run.partial().join("summary.json"), "3").unwrap();
        run.put_in_place().unwrap();
        assert_eq!(std::fs::read_to_string(out.join("summary.json")).unwrap(), "3");
        assert!(!out.join("defects.json").exists(), "a result of the run before");
    }

    #[test]
    fn a_folder_of_something_else_is_taken_only_by_force() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("holiday.jpg"), "").unwrap();
        let error = ResultsOut::prepare(folder.path(), false).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("holds holiday.jpg but no earlier results"), "{error}");
        drop(ResultsOut::prepare(folder.path(), true).unwrap());
        std::fs::create_dir(folder.path().join("cards")).unwrap();
        let error = ResultsOut::prepare(folder.path(), true).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("holds a folder cards that is no earlier result"), "{error}");
        assert!(folder.path().join("holiday.jpg").exists());
    }
}
