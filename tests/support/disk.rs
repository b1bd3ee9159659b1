//! A disk that a test makes faulty: a library that is preloaded into the service, and the numbers that steer it.

use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::repository;

/// How often calls on the disk fail, and how long they take.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Faults {
    /// How many of a thousand writes fail.
    pub writes_fail: u32,
    /// How many of a thousand writes find no room.
    pub no_room: u32,
    /// How many of a thousand writes write half.
    pub short_writes: u32,
    /// How many of a thousand syncs fail.
    pub syncs_fail: u32,
    /// Microseconds that each call takes.
    pub delay_us: u32,
}

/// The disk under a folder, for the processes that [`Disk::under`] has prepared.
pub struct Disk {
    library: PathBuf,
    control: PathBuf,
    numbers: std::fs::File,
    folder: PathBuf,
}

/// Places of the numbers in the control file, in the order of `disk.c`.
const FAULTS: usize = 6;
const SKIPPED: usize = 7;
const REFUSED: usize = 8;
const NUMBERS: usize = 9;

impl Disk {
    /// Compiles the library, into `tools`, for the files in `folder`.
    pub fn new(tools: &Path, folder: &Path) -> Self {
        let (library, control) = (tools.join("disk.so"), tools.join("control"));
        if !library.exists() {
            let mut compile = Command::new("cc");
            compile.args(["-O1", "-shared", "-fPIC", "-o"]).arg(&library).arg(repository("tests/support/disk.c"));
            assert!(compile.arg("-ldl").status().expect("the Rust toolchain links with cc").success());
        }
        std::fs::write(&control, [0; 4 * NUMBERS]).unwrap();
        let numbers = std::fs::File::options().read(true).write(true).open(&control).unwrap();
        Self { library, control, numbers, folder: folder.to_owned() }
    }

    /// Makes a command run on this disk.
    pub fn under(&self, mut command: Command) -> Command {
        command.env("LD_PRELOAD", &self.library).env("PLUMBLINE_FAULTS", &self.control);
        command.env("PLUMBLINE_FAULTY_FOLDER", &self.folder);
        command
    }

    pub fn set(&self, faults: Faults) {
        let Faults { writes_fail, no_room, short_writes, syncs_fail, delay_us } = faults;
        for (place, number) in [writes_fail, no_room, short_writes, syncs_fail, delay_us].into_iter().enumerate() {
            self.write(place, number);
        }
    }

    /// Lets so many writes pass, and has no room for the one after them.
    pub fn refuse_after(&self, skipped: u32) {
        self.write(SKIPPED, skipped);
        self.write(REFUSED, 1);
    }

    /// Takes back what [`Self::refuse_after`] asked; returns whether it had happened.
    pub fn has_refused(&self) -> bool {
        let has = self.read(REFUSED) == 0;
        self.write(REFUSED, 0);
        has
    }

    /// Returns the number of faults so far.
    pub fn faults(&self) -> u32 {
        self.read(FAULTS)
    }

    fn write(&self, place: usize, number: u32) {
        self.numbers.write_all_at(&number.to_ne_bytes(), 4 * place as u64).unwrap();
    }

    fn read(&self, place: usize) -> u32 {
        let mut bytes = [0; 4];
        self.numbers.read_exact_at(&mut bytes, 4 * place as u64).unwrap();
        u32::from_ne_bytes(bytes)
    }
}
