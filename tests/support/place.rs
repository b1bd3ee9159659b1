//! A database whose disk, or whose line to the server, a test can make faulty.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use plumbline::store::db::Pool;

use super::Service;
use super::commands::{key, plumbline, succeeded};
use super::database::{is_postgres, named, pool, url};
use super::disk::{Disk, Faults};
use super::line::{Line, Passes};

const NONE: Faults = Faults { writes_fail: 0, no_room: 0, short_writes: 0, syncs_fail: 0, delay_us: 0 };
const DISK_FAULTS: [Faults; 7] = [
    Faults { writes_fail: 30, ..NONE },
    Faults { no_room: 30, ..NONE },
    Faults { no_room: 1_000, ..NONE },
    Faults { short_writes: 100, ..NONE },
    Faults { syncs_fail: 100, ..NONE },
    Faults { syncs_fail: 1_000, ..NONE },
    Faults { delay_us: 20_000, ..NONE },
];
const LINE_FAULTS: [Passes; 3] = [Passes::Late, Passes::Nothing, Passes::Cut];

/// Returns the fault of a number, which begins anew after the last one.
const fn nth<T: Copy>(faults: &[T], which: u64) -> T {
    faults[(which % faults.len() as u64) as usize]
}

enum Weakness {
    /// The disk of a SQLite file.
    Disk(Disk),
    /// The line to a PostgreSQL server.
    Line(Line),
}

pub struct Place {
    pub database: PathBuf,
    weakness: Weakness,
    pub key: String,
}

impl Place {
    pub async fn new(folder: &Path) -> Self {
        let home = folder.join("home");
        std::fs::create_dir(&home).unwrap();
        let database = home.join("p.db");
        succeeded(&plumbline(&["migrate", "--create"], &database));
        let key = key(&database, "lab");
        let weakness = if is_postgres() {
            Weakness::Line(Line::to(port_of(&url(&database))).await)
        } else {
            Weakness::Disk(Disk::new(folder, &home))
        };
        Self { database, weakness, key }
    }

    /// Starts a service by a command that runs the program, on the disk or the line that can be made faulty.
    pub fn start(&self, program: Command, arguments: &[&str]) -> Service {
        match &self.weakness {
            Weakness::Disk(disk) => Service::start_by(disk.under(program), &self.database, arguments),
            Weakness::Line(line) => {
                let through = |argument: OsString| match argument.to_str() {
                    Some(url) if url.contains("://") => through_port(url, line.port).into(),
                    _ => argument,
                };
                let mut command = program;
                command.arg("serve").args(named(&self.database).into_iter().map(through)).args(arguments);
                Service::launch(command)
            }
        }
    }

    /// Returns the number of kinds of faults.
    pub const fn kinds(&self) -> usize {
        match self.weakness {
            Weakness::Disk(_) => DISK_FAULTS.len(),
            Weakness::Line(_) => LINE_FAULTS.len(),
        }
    }

    /// Returns the name of the fault of a number.
    pub fn name_of(&self, which: u64) -> String {
        match self.weakness {
            Weakness::Disk(_) => format!("{:?}", nth(&DISK_FAULTS, which)),
            Weakness::Line(_) => format!("{:?}", nth(&LINE_FAULTS, which)),
        }
    }

    /// Begins the fault of a number.
    pub fn begin_fault(&self, which: u64) {
        match &self.weakness {
            Weakness::Disk(disk) => disk.set(nth(&DISK_FAULTS, which)),
            Weakness::Line(line) => line.set(nth(&LINE_FAULTS, which)),
        }
    }

    pub fn end_fault(&self) {
        match &self.weakness {
            Weakness::Disk(disk) => disk.set(NONE),
            Weakness::Line(line) => line.set(Passes::All),
        }
    }

    /// Connects to the database, past the weakness.
    pub async fn pool(&self) -> Pool {
        pool(&self.database).await
    }
}

/// Returns the port of the server that a URL names.
fn port_of(url: &str) -> u16 {
    url.split([':', '/']).find_map(|part| part.parse().ok()).expect("a URL with a port")
}

fn through_port(url: &str, port: u16) -> String {
    url.replace(&format!(":{}/", port_of(url)), &format!(":{port}/"))
}
