//! The lock file of a served database, `FILE.lock`, which tells a process whether others serve the same file.
//!
//! Several processes may serve one file. The system releases a lock when its process ends, however it ends, so the file
//! itself says nothing: it stays behind.

use std::fs::File;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

/// A share of the lock, held until it is dropped.
#[derive(Debug)]
pub struct Serving {
    _file: File,
    /// Whether other processes held a share before.
    pub is_shared: bool,
}

impl Serving {
    /// Takes a share of the lock of a database.
    ///
    /// # Errors
    /// Returns an error if the lock file cannot be created, or the file system has no locks.
    pub fn of(database: &Path) -> std::io::Result<Self> {
        let mut name = database.as_os_str().to_owned();
        name.push(".lock");
        let file = File::options().create(true).append(true).mode(0o600).open(PathBuf::from(name))?;
        // Alone, a process gets the whole lock, and then keeps a share.
        let is_shared = match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => false,
            Err(Errno::WOULDBLOCK) => true,
            Err(error) => return Err(error.into()),
        };
        // Waits only while another process is between these two calls.
        flock(&file, FlockOperation::LockShared)?;
        Ok(Self { _file: file, is_shared })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_sees_others_that_live_and_no_others() {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("p.db");
        let first = Serving::of(&database).unwrap();
        let second = Serving::of(&database).unwrap();
        let third = Serving::of(&database).unwrap();
        assert_eq!([first.is_shared, second.is_shared, third.is_shared], [false, true, true]);
        drop((first, second));
        let fourth = Serving::of(&database).unwrap();
        assert!(fourth.is_shared, "the third still serves");
        drop((third, fourth));
        assert!(!Serving::of(&database).unwrap().is_shared, "the file is left, but nobody holds it");
    }
}
