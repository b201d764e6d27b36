//! The recordings of `train`, each with the range of it that is intact.

use super::recording::Recording;
use anyhow::ensure;
use ropescope::pipeline::TrainingRange;
use std::path::{Path, PathBuf};

/// A recording to learn from, and what is intact of it.
pub(crate) struct TrainFolder {
    /// As it was written, the first time that it was.
    pub name: String,
    /// What is in it.
    pub recording: Recording,
    from_m: Option<f64>,
    to_m: Option<f64>,
}

/// A rope metre, or an end of the recording in a word.
#[derive(Clone, Copy)]
pub(crate) struct Bound(Option<f64>);

/// Reads `--from-m`.
pub(crate) fn from_m(text: &str) -> Result<Bound, String> {
    bound(text, "start")
}

/// Reads `--to-m`.
pub(crate) fn to_m(text: &str) -> Result<Bound, String> {
    bound(text, "end")
}

fn bound(text: &str, word: &str) -> Result<Bound, String> {
    if text == word {
        return Ok(Bound(None));
    }
    text.parse().map(|metre| Bound(Some(metre))).map_err(|_| format!("neither a rope metre nor the word {word:?}"))
}

/// What is wrong with how often an option was given; `None`: nothing.
pub(crate) fn wrong_count(option: &str, word: &str, given: usize, folders: usize) -> Option<String> {
    (given != 0 && given != folders).then(|| {
        let times = |n: usize| if n == 1 { "once".to_owned() } else { format!("{n} times") };
        format!(
            "{option} is given {}, but there {}: give it once for each folder, in their order ('{option} {word}' where all is meant), \
             or not at all",
            times(given),
            if folders == 1 { "is 1 folder".to_owned() } else { format!("are {folders} folders") },
        )
    })
}

impl TrainFolder {
    /// Opens every folder with its bounds; there are as many as folders, or none. Errors: a folder that is no recording, a range
    /// that is not in it.
    pub(crate) fn open_all(folders: &[PathBuf], from_m: &[Bound], to_m: &[Bound]) -> anyhow::Result<Vec<Self>> {
        let number_of_first = |path: &Path| {
            let same = |other: &PathBuf| other == path || other.canonicalize().ok() == path.canonicalize().ok();
            folders.iter().position(same).unwrap_or(0)
        };
        let bound = |bounds: &[Bound], number: usize| bounds.get(number).and_then(|bound| bound.0);
        let open = |(number, path): (usize, &PathBuf)| {
            let name = folders[number_of_first(path)].display().to_string();
            let recording = Recording::open(path)?;
            let folder = Self { name, recording, from_m: bound(from_m, number), to_m: bound(to_m, number) };
            folder.check().map_err(|e| if folders.len() > 1 { e.context(folder.name.clone()) } else { e })?;
            Ok(folder)
        };
        folders.iter().enumerate().map(open).collect()
    }

    /// The same for the pipeline.
    pub(crate) fn range(&self) -> TrainingRange<'_> {
        let Recording { acquisition, frames, .. } = &self.recording;
        TrainingRange { name: &self.name, acquisition, source: frames, from_m: self.from_m, to_m: self.to_m }
    }

    fn check(&self) -> anyhow::Result<()> {
        let (start_m, end_m) = (self.recording.acquisition.start_m, self.recording.end_m());
        for (option, value) in [("--from-m", self.from_m), ("--to-m", self.to_m)] {
            let Some(value) = value else { continue };
            ensure!(
                (start_m..=end_m).contains(&value),
                "{option} is {value}, but the acquisition shows rope metres {start_m:.2} to {end_m:.2}"
            );
        }
        let (from_m, to_m) = (self.from_m.unwrap_or(start_m), self.to_m.unwrap_or(end_m));
        ensure!(from_m < to_m, "--from-m is {from_m}, but must be less than --to-m, which is {to_m}");
        Ok(())
    }
}
