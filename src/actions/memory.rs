//! Peak memory of a script. The engine does not report that memory ran out if the script catches the error, or if too
//! little memory was left to report it.

use std::fs::File;
use std::os::unix::fs::FileExt as _;

/// Growth of this process's peak memory since the start of the measurement.
#[derive(Debug)]
pub struct PeakMemory {
    /// Opened before confinement and never closed, since a confined process may neither open nor close files.
    status: Option<&'static File>,
    before: u64,
}

impl PeakMemory {
    /// Creates a measurement that always reports 0.
    #[must_use]
    pub const fn unknown() -> Self {
        Self { status: None, before: 0 }
    }

    /// Starts measuring this process.
    #[must_use]
    pub fn of_this_process() -> Self {
        let status = File::open("/proc/self/status").ok().map(|file| &*Box::leak(Box::new(file)));
        let mut own = Self { status, before: 0 };
        own.before = own.read().unwrap_or(0);
        own
    }

    /// Returns the growth in bytes, or 0 if the system does not report it.
    #[must_use]
    pub fn grown_by(&self) -> u64 {
        self.read().map_or(0, |now| now.saturating_sub(self.before))
    }

    /// Returns the peak memory less the pages of files that are there now: how much of the program is in memory depends
    /// on the system, and in a process that was just forked most of it is read in while the script runs.
    fn read(&self) -> Option<u64> {
        let mut text = [0; 4_096];
        let length = self.status?.read_at(&mut text, 0).ok()?;
        let text = std::str::from_utf8(&text[..length]).ok()?;
        let kib = |name| -> Option<u64> {
            let line = text.lines().find_map(|line| line.strip_prefix(name))?;
            line.trim().strip_suffix("kB")?.trim().parse().ok()
        };
        Some(kib("VmHWM:")?.saturating_sub(kib("RssFile:").unwrap_or(0)) << 10)
    }
}
