//! The database file as it was opened: whether it is still where it was.

use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use super::{StoreError, StoreResult};

/// A database file, with what tells it from another that takes its place: the device and the inode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OpenedFile {
    path: PathBuf,
    identity: (u64, u64),
}

impl OpenedFile {
    /// Returns the file at a path, which is open; `None` if there is none, or its file system tells no file from another.
    #[must_use]
    pub fn opened(path: &Path) -> Option<Self> {
        // Opening the file once more, to ask its handle, would release SQLite's locks when it is closed.
        Self::at(path).filter(|file| Self::at(path).as_ref() == Some(file))
    }

    fn at(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|file| Self { path: path.to_owned(), identity: (file.dev(), file.ino()) })
    }

    /// Checks that the file is where it was.
    ///
    /// # Errors
    /// Returns an error if it was deleted, moved or replaced: what is written then is lost when the process ends.
    pub fn must_be_in_place(&self) -> StoreResult<()> {
        match Self::at(&self.path) {
            Some(now) if now == *self => Ok(()),
            _ => Err(StoreError::LostFile(self.path.clone())),
        }
    }

    /// Sets the log of the file aside if another file took its place, which would be damaged by it at the next start.
    /// Returns whether it did.
    ///
    /// # Errors
    /// Returns an error if the log cannot be renamed.
    pub fn set_log_aside(&self) -> std::io::Result<bool> {
        let is_replaced = Self::at(&self.path).is_some_and(|now| now != *self);
        let beside = |ending: &str| PathBuf::from(format!("{}{ending}", self.path.display()));
        let mut is_done = false;
        for ending in ["-wal", "-shm"].into_iter().filter(|_| is_replaced) {
            match std::fs::rename(beside(ending), beside(&format!("{ending}.lost"))) {
                Ok(()) => is_done = true,
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(is_done)
    }
}
