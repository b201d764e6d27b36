//! What an archive of an acquisition folder holds. Nothing is written where a name points to: names only say which frame it is, and
//! an archive with a name or an entry that an honest one does not have is refused as a whole.

use crate::pipeline::acquisition::RopeFile;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};

/// Most entries of an archive.
const MAX_ENTRIES: usize = 2_000_000;
/// Longest `rope.json`.
const MAX_ROPE_JSON: u64 = 256 << 10;
/// An archive may grow by this factor when it is unpacked: images are compressed already, and a bomb is not worth its disk.
const MAX_GROWTH: u64 = 50;
/// .. beside what small archives always may.
const GROWTH_FREE: u64 = 64 << 20;

/// Why an archive is refused.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// Neither tar nor zip, or cut off.
    #[error("it is no whole tar or zip file: {0}")]
    Unreadable(String),
    /// An entry that an honest archive does not have.
    #[error("the entry {name:?} is {what}; an archive holds rope.json and the frames of every view")]
    Hostile {
        /// Its name.
        name: String,
        /// What is wrong with it.
        what: &'static str,
    },
    /// More than it says, or more than any archive may have.
    #[error("{quantity} is {value}, but may be at most {limit}")]
    TooLarge {
        /// What is too large.
        quantity: String,
        /// How large it is.
        value: u64,
        /// The limit.
        limit: u64,
    },
    /// No acquisition.
    #[error("{0}")]
    NoAcquisition(String),
}

impl From<std::io::Error> for ArchiveError {
    fn from(error: std::io::Error) -> Self {
        Self::Unreadable(error.to_string())
    }
}

/// What an archive holds, after its first reading.
#[derive(Debug)]
pub struct Contents {
    /// Its `rope.json`.
    pub rope_file: RopeFile,
    /// Frames of each view.
    pub frames: Vec<u32>,
    /// Bytes of all frames.
    pub bytes: u64,
    /// View and number by name.
    numbers: BTreeMap<PathBuf, (u32, u32)>,
}

/// Reads through an archive: every name is judged before anything is taken.
pub fn contents(path: &Path, frame_bytes: u64) -> Result<Contents, ArchiveError> {
    let (mut files, mut rope_json) = (Vec::new(), None);
    let (mut total, mut entries) = (0_u64, 0);
    let limit = std::fs::metadata(path)?.len().saturating_mul(MAX_GROWTH).saturating_add(GROWTH_FREE);
    each_file(path, |name, size, content| {
        entries += 1;
        total = total.saturating_add(size);
        at_most("the number of entries", entries, MAX_ENTRIES as u64)?;
        at_most("the unpacked size", total, limit)?;
        if name.file_name().is_some_and(|n| n == "rope.json") && rope_json.is_none() {
            at_most("the size of rope.json", size, MAX_ROPE_JSON)?;
            let mut text = Vec::new();
            content.take(MAX_ROPE_JSON).read_to_end(&mut text)?;
            rope_json = Some((name.parent().unwrap_or(Path::new("")).to_owned(), text));
        } else {
            files.push((name, size));
        }
        Ok(())
    })?;
    let (folder, text) = rope_json.ok_or_else(|| ArchiveError::NoAcquisition("it has no rope.json".into()))?;
    let rope_file: RopeFile = serde_json::from_slice(&text)
        .map_err(|e| ArchiveError::NoAcquisition(format!("its rope.json is not valid: {e}")))?;
    rope_file.validate().map_err(|e| ArchiveError::NoAcquisition(e.to_string()))?;
    let (mut numbers, mut bytes) = (BTreeMap::new(), 0);
    let mut frames = vec![0; rope_file.views.len()];
    for (name, size) in files {
        let Some((view, number)) = place(&rope_file, &folder, &name) else { continue };
        at_most(&format!("the size of {}", name.display()), size, frame_bytes)?;
        bytes += size;
        frames[view as usize] += 1;
        if numbers.insert(name.clone(), (view, number)).is_some() {
            return Err(hostile(&name, "there twice"));
        }
    }
    for (view, &count) in (0..).zip(&frames) {
        let of_view = numbers.values().filter(|(v, _)| *v == view);
        let last = of_view.map(|(_, number)| *number).max();
        if count == 0 || last != Some(count - 1) {
            let folder = &rope_file.views[view as usize].folder;
            return Err(ArchiveError::NoAcquisition(match last {
                None => format!("view {folder} has no frames"),
                Some(last) => {
                    format!("view {folder} has {count} frames, but the last one is number {last}: some are missing")
                }
            }));
        }
    }
    Ok(Contents { rope_file, frames, bytes, numbers })
}

/// Gives every frame to `take`, with its view and number, in the order of the archive.
pub fn each_frame<E: From<ArchiveError>>(
    path: &Path,
    contents: &Contents,
    frame_bytes: u64,
    mut take: impl FnMut(u32, u32, &mut dyn Read) -> Result<(), E>,
) -> Result<(), E> {
    let mut outcome = Ok(());
    let read = each_file(path, |name, size, content| {
        if let Some(&(view, number)) = contents.numbers.get(&name)
            && outcome.is_ok()
        {
            // What a header promises is the most that is read, whatever follows.
            outcome = take(view, number, &mut content.take(size.min(frame_bytes)));
        }
        Ok(())
    });
    outcome?;
    Ok(read?)
}

fn at_most(quantity: &str, value: u64, limit: u64) -> Result<(), ArchiveError> {
    if value <= limit { Ok(()) } else { Err(ArchiveError::TooLarge { quantity: quantity.into(), value, limit }) }
}

fn hostile(name: &Path, what: &'static str) -> ArchiveError {
    ArchiveError::Hostile { name: name.to_string_lossy().into_owned(), what }
}

/// View and number of a frame; `None` for other files.
fn place(rope_file: &RopeFile, folder: &Path, name: &Path) -> Option<(u32, u32)> {
    let inside = name.strip_prefix(folder).ok()?;
    let view = rope_file.views.iter().position(|view| inside.parent() == Some(Path::new(&view.folder)))?;
    let image = inside.extension().and_then(|e| e.to_str()).is_some_and(|e| matches!(e, "png" | "tif" | "tiff"));
    let number = inside.file_stem()?.to_str()?.strip_prefix("frame_")?.parse().ok()?;
    image.then_some((view as u32, number))
}

/// A name that stays where it is: relative, without `..`. Errors: every other.
fn plain(name: &Path) -> Result<PathBuf, ArchiveError> {
    let mut plain = PathBuf::new();
    for part in name.components() {
        match part {
            Component::Normal(part) => plain.push(part),
            Component::CurDir => {}
            _ => return Err(hostile(name, "outside the archive")),
        }
    }
    if name.to_string_lossy().contains(['\\', '\0']) {
        return Err(hostile(name, "outside the archive on some systems"));
    }
    Ok(plain)
}

/// Gives every plain file to `take`: name, unpacked size as promised, content.
fn each_file(
    path: &Path,
    take: impl FnMut(PathBuf, u64, &mut dyn Read) -> Result<(), ArchiveError>,
) -> Result<(), ArchiveError> {
    let mut file = File::open(path)?;
    let mut magic = [0; 4];
    let zip = file.read(&mut magic)? == 4 && magic == *b"PK\x03\x04";
    file.seek(SeekFrom::Start(0))?;
    let file = BufReader::with_capacity(1 << 18, file);
    if zip { each_in_zip(file, take) } else { each_in_tar(file, take) }
}

fn each_in_zip(
    file: BufReader<File>,
    mut take: impl FnMut(PathBuf, u64, &mut dyn Read) -> Result<(), ArchiveError>,
) -> Result<(), ArchiveError> {
    let unreadable = |e: zip::result::ZipError| ArchiveError::Unreadable(e.to_string());
    let mut archive = zip::ZipArchive::new(file).map_err(unreadable)?;
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index).map_err(unreadable)?;
        let name = PathBuf::from(entry.name().map_err(unreadable)?.into_owned());
        let plain = plain(&name)?;
        if entry.is_symlink() {
            return Err(hostile(&name, "a link"));
        }
        if entry.is_dir() {
            continue;
        }
        let size = entry.size();
        take(plain, size, &mut entry)?;
    }
    Ok(())
}

fn each_in_tar(
    file: BufReader<File>,
    mut take: impl FnMut(PathBuf, u64, &mut dyn Read) -> Result<(), ArchiveError>,
) -> Result<(), ArchiveError> {
    let mut archive = tar::Archive::new(file);
    for entry in archive.entries()? {
        let mut entry = entry?;
        let name = entry.path()?.into_owned();
        let kind = entry.header().entry_type();
        if kind.is_pax_global_extensions() {
            continue;
        }
        let plain = plain(&name)?;
        if kind.is_dir() {
            continue;
        }
        if !kind.is_file() {
            return Err(hostile(&name, "a link or a device"));
        }
        let size = entry.size();
        take(plain, size, &mut entry)?;
    }
    Ok(())
}
