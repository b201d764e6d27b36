//! The data folder: where files lie, how they are made durable, and who else works on them.
//!
//! ```text
//! ropescope.db                                      facts
//! frames/<acquisition>/<view>/<frame>-<sha256>      uploaded frames, as they came
//! previews/<acquisition>/<view>/<frame>-<sha256>    reduced forms of frames that are still to come
//! models/<model>                                    appearance models
//! inspections/<inspection>/                         results folders
//! uploads/                                          frames on their way in
//! archives/<archive>                                whole recordings on their way in
//! work/                                             results on their way out
//! instances/<instance>                              one locked file a living process
//! signing-key.pk8                                   secret key of receipts
//! ```

use super::{Id, StoreError};
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use uuid::Uuid;

/// The data folder of a service.
#[derive(Debug, Clone)]
pub struct DataFolder(Arc<Path>);

/// Proof that this process is alive: a file under lock, which the kernel frees however the process ends.
#[derive(Debug)]
pub struct Instance {
    /// Name of this process in leases.
    pub id: Uuid,
    path: PathBuf,
    _lock: File,
}

impl Drop for Instance {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path); // left over, it only costs a look at the next start
    }
}

impl DataFolder {
    /// Opens the folder and makes what is missing in it.
    pub(super) fn open(path: &Path) -> Result<Self, StoreError> {
        let folder = Self(path.into());
        for part in [
            folder.frames(),
            folder.previews(),
            folder.models(),
            folder.inspections(),
            folder.uploads(),
            folder.archives(),
            folder.work(),
        ] {
            make_folder(&part)?;
        }
        make_folder(&folder.instances())?;
        sync_folder(path)?;
        Ok(folder)
    }

    pub(super) fn database(&self) -> PathBuf {
        self.0.join("ropescope.db")
    }

    pub(super) fn frames(&self) -> PathBuf {
        self.0.join("frames")
    }

    pub(super) fn previews(&self) -> PathBuf {
        self.0.join("previews")
    }

    pub(super) fn models(&self) -> PathBuf {
        self.0.join("models")
    }

    pub(super) fn inspections(&self) -> PathBuf {
        self.0.join("inspections")
    }

    /// Where uploads are written before they are checked.
    pub fn uploads(&self) -> PathBuf {
        self.0.join("uploads")
    }

    /// Where archives are written until they are unpacked.
    pub(super) fn archives(&self) -> PathBuf {
        self.0.join("archives")
    }

    /// Where workers write before their results are accepted.
    pub fn work(&self) -> PathBuf {
        self.0.join("work")
    }

    /// The secret key that signs receipts.
    pub(super) fn signing_key(&self) -> PathBuf {
        self.0.join("signing-key.pk8")
    }

    /// Bytes that the disk still has for this process.
    pub fn free_bytes(&self) -> Result<u64, StoreError> {
        fs4::available_space(&*self.0).map_err(|source| StoreError::File { path: self.0.to_path_buf(), source })
    }

    fn instances(&self) -> PathBuf {
        self.0.join("instances")
    }

    /// Folder of the frames of an acquisition.
    pub(super) fn acquisition(&self, acquisition: Id) -> PathBuf {
        self.frames().join(acquisition.to_string())
    }

    /// File of a frame. The digest in its name keeps two uploads that race for one number apart.
    pub fn frame(&self, acquisition: Id, view: u32, frame: u32, sha256_hex: &str) -> PathBuf {
        self.acquisition(acquisition).join(view.to_string()).join(format!("{frame:06}-{sha256_hex}"))
    }

    /// Folder of the previews of an acquisition.
    pub(super) fn previews_of(&self, acquisition: Id) -> PathBuf {
        self.previews().join(acquisition.to_string())
    }

    /// File of a preview, named as frames are.
    pub fn preview(&self, acquisition: Id, view: u32, frame: u32, sha256_hex: &str) -> PathBuf {
        self.previews_of(acquisition).join(view.to_string()).join(format!("{frame:06}-{sha256_hex}"))
    }

    /// File of a model.
    pub fn model(&self, model: Id) -> PathBuf {
        self.models().join(model.to_string())
    }

    /// Results folder of an inspection.
    pub fn inspection(&self, inspection: Id) -> PathBuf {
        self.inspections().join(inspection.to_string())
    }

    /// Line scores of a view of an inspection; not there if it was made without a model.
    pub fn line_scores(&self, inspection: Id, view: u32) -> PathBuf {
        self.inspection(inspection).join(format!("line_scores_view{view}.f32"))
    }

    /// Likelihood map of a frame of an inspection; not there if it was made without a model.
    pub fn likelihood_map(&self, inspection: Id, view: u32, frame: u32) -> PathBuf {
        self.inspection(inspection).join(format!("maps/view{view}/frame_{frame:06}.png"))
    }

    /// Claims the folder for the one `serve` it may have.
    pub fn lock_for_service(&self) -> Result<File, StoreError> {
        let path = self.0.join("serve.lock");
        let file = File::create(&path).map_err(|source| StoreError::File { path: path.clone(), source })?;
        match file.try_lock() {
            Ok(()) => Ok(file),
            Err(TryLockError::WouldBlock) => Err(StoreError::InUse { path: self.0.to_path_buf() }),
            Err(TryLockError::Error(source)) => Err(StoreError::File { path, source }),
        }
    }

    /// Registers this process as alive.
    pub fn register(&self, id: Uuid) -> Result<Instance, StoreError> {
        let path = self.instances().join(id.to_string());
        let unborn = self.instances().join(format!("{id}.new"));
        let failed = |source| StoreError::File { path: path.clone(), source };
        // Under lock before it has its name, or a process that looks around just now would take it for dead.
        let lock = File::create(&unborn).map_err(failed)?;
        lock.lock().map_err(failed)?;
        fs::rename(&unborn, &path).map_err(failed)?;
        Ok(Instance { id, path, _lock: lock })
    }

    /// True while the process that registered as `instance` lives.
    pub fn alive(&self, instance: &str) -> bool {
        if Uuid::parse_str(instance).is_err() {
            return false; // never leave the folder because of a strange name
        }
        match File::open(self.instances().join(instance)) {
            Ok(file) => matches!(file.try_lock(), Err(TryLockError::WouldBlock)),
            Err(_) => false,
        }
    }

    /// Other living processes on this folder; files of dead ones are removed.
    pub fn others(&self, own: &Instance) -> Result<usize, StoreError> {
        let mut others = 0;
        for path in entries(&self.instances())? {
            let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
            if name == own.id.to_string() || name.ends_with(".new") {
                continue;
            }
            if self.alive(&name) {
                others += 1;
            } else {
                remove(&path)?;
            }
        }
        Ok(others)
    }
}

/// What lies in a folder; nothing if it does not exist.
pub(super) fn entries(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let failed = |source| StoreError::File { path: folder.into(), source };
    match fs::read_dir(folder) {
        Ok(listing) => listing.map(|e| e.map(|e| e.path()).map_err(failed)).collect(),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(e) => Err(failed(e)),
    }
}

/// Makes a folder and its parents.
pub fn make_folder(path: &Path) -> Result<(), StoreError> {
    fs::create_dir_all(path).map_err(|source| StoreError::File { path: path.into(), source })
}

/// Removes a file or a whole folder; fine if it is not there.
pub fn remove(path: &Path) -> Result<(), StoreError> {
    let done = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match done {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(StoreError::File { path: path.into(), source: e }),
        _ => Ok(()),
    }
}

/// Length of a file.
pub fn length(path: &Path) -> Result<u64, StoreError> {
    fs::metadata(path).map(|m| m.len()).map_err(|source| StoreError::File { path: path.into(), source })
}

/// Makes the names in a folder durable.
pub fn sync_folder(path: &Path) -> Result<(), StoreError> {
    File::open(path).and_then(|f| f.sync_all()).map_err(|source| StoreError::File { path: path.into(), source })
}

/// Makes a file or a folder with everything in it durable.
pub fn sync_tree(path: &Path) -> Result<(), StoreError> {
    if path.is_dir() {
        for entry in entries(path)? {
            sync_tree(&entry)?;
        }
    }
    sync_folder(path)
}

/// Moves a file or folder whose content is durable to its final place, durably: new parents, rename, parents.
pub fn move_durably(from: &Path, to: &Path) -> Result<(), StoreError> {
    let failed = |source| StoreError::File { path: to.into(), source };
    let parent = to.parent().unwrap_or(Path::new("."));
    if !parent.is_dir() {
        make_folder(parent)?;
        // A new folder is durable when its own name is: the two levels that frames need.
        for above in parent.ancestors().skip(1).take(2) {
            sync_folder(above)?;
        }
    }
    fs::rename(from, to).map_err(failed)?;
    sync_folder(parent)
}
