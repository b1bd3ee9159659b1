//! How much memory a script took at most: the engine does not say where a script catches that memory ran out, or where there was too
//! little left to say so.

use std::fs::File;
use std::os::unix::fs::FileExt as _;

/// The greatest size of this process in memory, beyond what it was in the beginning.
#[derive(Debug)]
pub struct PeakMemory {
    /// Opened before files can no longer be opened, and never closed: a confined process may not do that either.
    status: Option<&'static File>,
    before: u64,
}

impl PeakMemory {
    /// Where nobody asks.
    #[must_use]
    pub const fn unknown() -> Self {
        Self { status: None, before: 0 }
    }

    /// From now on.
    #[must_use]
    pub fn of_this_process() -> Self {
        let status = File::open("/proc/self/status").ok().map(|file| &*Box::leak(Box::new(file)));
        let mut own = Self { status, before: 0 };
        own.before = own.read().unwrap_or(0);
        own
    }

    /// Bytes by which it has grown; 0 where the system does not tell.
    #[must_use]
    pub fn grown_by(&self) -> u64 {
        self.read().map_or(0, |now| now.saturating_sub(self.before))
    }

    fn read(&self) -> Option<u64> {
        let mut text = [0; 4_096];
        let length = self.status?.read_at(&mut text, 0).ok()?;
        let text = std::str::from_utf8(&text[..length]).ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
        let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
        Some(kib << 10)
    }
}
