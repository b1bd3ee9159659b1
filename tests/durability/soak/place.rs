//! Where the service of a soak stands: a database, and what makes its disk or its line to the server faulty.

use std::path::{Path, PathBuf};
use std::process::Command;

use plumbline::store::db::Pool;

use crate::support::commands::{key, plumbline, succeeded};
use crate::support::database::{is_postgres, pool, url};
use crate::support::disk::{Disk, Faults};
use crate::support::line::{Line, Passes};
use crate::support::{PROGRAM, Service};

enum Weakness {
    /// The disk of a SQLite file.
    Disk(Disk),
    /// The line to a PostgreSQL server.
    Line(Line),
}

pub struct Place {
    database: PathBuf,
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
            let port = url(&database).split([':', '/']).find_map(|part| part.parse().ok()).expect("a URL with a port");
            Weakness::Line(Line::to(port).await)
        } else {
            Weakness::Disk(Disk::new(folder, &home))
        };
        Self { database, weakness, key }
    }

    /// Starts a service whose disk or line can be made faulty.
    pub fn start(&self) -> Service {
        let program = std::env::var_os("PLUMBLINE_SOAK_PROGRAM").unwrap_or_else(|| PROGRAM.into());
        let arguments = ["--lease-seconds", "2"];
        match &self.weakness {
            Weakness::Disk(disk) => Service::start_by(disk.under(Command::new(program)), &self.database, &arguments),
            Weakness::Line(line) => {
                let direct = url(&self.database);
                let port = direct.split([':', '/']).find(|part| part.parse::<u16>().is_ok()).expect("checked by new");
                let through = direct.replace(&format!(":{port}/"), &format!(":{}/", line.port));
                let mut command = Command::new(program);
                command
                    .args(["serve", "--database", &through, "--secrets"])
                    .arg(self.database.with_extension("secrets"));
                command.args(arguments);
                Service::launch(command)
            }
        }
    }

    /// Begins the fault of this number, and names it.
    pub fn begin_fault(&self, which: u64) -> String {
        let none = Faults::default();
        match &self.weakness {
            Weakness::Disk(disk) => {
                let faults = match which % 7 {
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
                let passes = [Passes::Late, Passes::Nothing, Passes::Cut][(which % 3) as usize];
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
