//! The database file as it was opened: whether it is still where it was.

use std::collections::HashSet;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use super::{StoreError, StoreResult};

/// A database file that this process has open.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OpenedFile {
    /// Where it was opened. This may be a symbolic link.
    path: PathBuf,
    /// The file itself, beside which SQLite keeps its log.
    real: PathBuf,
    identity: Identity,
}

/// What tells a file from another that takes its place: the device and the inode.
type Identity = (u64, u64);

impl OpenedFile {
    /// Returns the file at a path, which is open; `None` if there is none, or its file system tells no file from another.
    #[must_use]
    pub fn opened(path: &Path) -> Option<Self> {
        // Opening the file once more, to ask its handle, would release SQLite's locks when it is closed.
        let identity = identity(path).filter(|first| identity(path) == Some(*first))?;
        let real = std::fs::canonicalize(path).ok()?;
        Some(Self { path: path.to_owned(), real, identity })
    }

    /// Checks that the file is where it was.
    ///
    /// # Errors
    /// Returns an error if it was deleted, moved or replaced: what is written then is lost when the process ends.
    pub fn must_be_in_place(&self) -> StoreResult<()> {
        if identity(&self.path) == Some(self.identity) {
            return Ok(());
        }
        Err(StoreError::LostFile(self.path.clone()))
    }

    /// Sets the log of the file aside if another file took its place, which would be damaged by it at the next start.
    /// Returns the new names. A log that this process does not have open belongs to that other file, and stays.
    ///
    /// # Errors
    /// Returns an error if the log cannot be renamed.
    pub fn set_log_aside(&self) -> std::io::Result<Vec<PathBuf>> {
        let beside = |ending: &str| PathBuf::from(format!("{}{ending}", self.real.display()));
        let mut set_aside = Vec::new();
        if identity(&self.real).is_none_or(|now| now == self.identity) {
            return Ok(set_aside);
        }
        let opened = opened_by_this_process()?;
        for ending in ["-wal", "-shm"] {
            let log = beside(ending);
            if identity(&log).is_none_or(|identity| !opened.contains(&identity)) {
                continue;
            }
            let mut names = (1_u32..).map(|number| match number {
                1 => beside(&format!("{ending}.lost")),
                _ => beside(&format!("{ending}.lost-{number}")),
            });
            // What was set aside before may be all that is left of it.
            let free = names.find(|name| !name.exists()).expect("a folder is finite");
            std::fs::rename(&log, &free)?;
            set_aside.push(free);
        }
        Ok(set_aside)
    }
}

fn identity(path: &Path) -> Option<Identity> {
    std::fs::metadata(path).ok().map(|file| (file.dev(), file.ino()))
}

/// Returns the files that this process has open.
fn opened_by_this_process() -> std::io::Result<HashSet<Identity>> {
    let descriptors = std::fs::read_dir("/proc/self/fd")?;
    Ok(descriptors.filter_map(|descriptor| identity(&descriptor.ok()?.path())).collect())
}
