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
    pub fn kinds(&self) -> u64 {
        match self.weakness {
            Weakness::Disk(_) => 7,
            Weakness::Line(_) => 3,
        }
    }

    /// Begins the fault of this number, and names it.
    pub fn begin_fault(&self, which: u64) -> String {
        let none = Faults::default();
        match &self.weakness {
            Weakness::Disk(disk) => {
                let faults = match which % self.kinds() {
                    0 => Faults { writes_fail: 30, ..none },
                    1 => Faults { no_room: 30, ..none },
                    2 => Faults { no_room: 1_000, ..none },
                    3 => Faults { short_writes: 100, ..none },
                    4 => Faults { syncs_fail: 100, ..none },
                    5 => Faults { syncs_fail: 1_000, ..none },
                    _ => Faults { delay_us: 20_000, ..none },
                };
                disk.set(faults);
                format!("{faults:?}")
            }
            Weakness::Line(line) => {
                let passes = [Passes::Late, Passes::Nothing, Passes::Cut][(which % self.kinds()) as usize];
                line.set(passes);
                format!("{passes:?}")
            }
        }
    }

    pub fn end_fault(&self) {
        match &self.weakness {
            Weakness::Disk(disk) => disk.set(Faults::default()),
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
