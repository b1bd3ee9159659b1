//! The database file as it was opened: whether it is still where it was.

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
    /// Its log and the index of the log, which SQLite keeps beside it while it is open.
    logs: Vec<(&'static str, Identity)>,
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
        let beside = ["-wal", "-shm"].into_iter();
        let logs = beside.filter_map(|ending| Some((ending, self::identity(&beside_of(&real, ending))?))).collect();
        Some(Self { path: path.to_owned(), real, identity, logs })
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
    /// Returns the new names. A log that is not the one of the opening belongs to that other file, and stays.
    ///
    /// # Errors
    /// Returns an error if the log cannot be renamed.
    pub fn set_log_aside(&self) -> std::io::Result<Vec<PathBuf>> {
        let mut set_aside = Vec::new();
        if identity(&self.real).is_none_or(|now| now == self.identity) {
            return Ok(set_aside);
        }
        for (ending, own) in &self.logs {
            let log = beside_of(&self.real, ending);
            if identity(&log) != Some(*own) {
                continue;
            }
            let mut names = (1_u32..).map(|number| match number {
                1 => beside_of(&self.real, &format!("{ending}.lost")),
                _ => beside_of(&self.real, &format!("{ending}.lost-{number}")),
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

/// Returns the path beside a file whose name has this ending.
fn beside_of(file: &Path, ending: &str) -> PathBuf {
    PathBuf::from(format!("{}{ending}", file.display()))
}
