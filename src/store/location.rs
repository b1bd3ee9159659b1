//! Where a database is: a SQLite file, or a PostgreSQL server.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sqlx::postgres::PgConnectOptions;

/// Location of a database. It prints without the password.
#[derive(Debug, Clone)]
pub enum Location {
    /// No database: what a node that only grades needs is in memory.
    Memory,
    /// SQLite file.
    File(PathBuf),
    /// PostgreSQL database.
    Server(Box<Server>),
}

/// PostgreSQL database, as a URL names it.
#[derive(Debug, Clone)]
pub struct Server {
    pub(super) options: PgConnectOptions,
    shown: String,
}

impl Location {
    /// Returns the file, if the database is one.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::File(file) => Some(file),
            Self::Memory | Self::Server(_) => None,
        }
    }

    /// Returns the server, if the database is on one.
    #[must_use]
    pub fn server(&self) -> Option<&Server> {
        match self {
            Self::Server(server) => Some(server),
            Self::Memory | Self::File(_) => None,
        }
    }

    /// Returns the folder of the secrets if the operator names none.
    #[must_use]
    pub fn default_secrets(&self) -> PathBuf {
        match self {
            Self::File(file) => {
                let mut name = file.as_os_str().to_owned();
                name.push(".secrets");
                name.into()
            }
            Self::Memory | Self::Server(_) => "plumbline.secrets".into(),
        }
    }
}

impl From<PathBuf> for Location {
    fn from(file: PathBuf) -> Self {
        Self::File(file)
    }
}

impl FromStr for Location {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Some((scheme, rest)) = text.split_once("://") else { return Ok(Self::File(text.into())) };
        match scheme {
            "postgres" | "postgresql" => {
                let options =
                    PgConnectOptions::from_str(text).map_err(|error| format!("not a PostgreSQL URL: {error}"))?;
                let shown = match rest.split_once('@') {
                    Some((who, place)) => format!("{scheme}://{}@{place}", who.split(':').next().unwrap_or_default()),
                    None => text.to_owned(),
                };
                // Parameters may hold a password, too.
                let shown = shown.split('?').next().unwrap_or_default().to_owned();
                Ok(Self::Server(Box::new(Server { options, shown })))
            }
            "sqlite" | "file" => Ok(Self::File(rest.into())),
            _ => {
                Err(format!("{scheme}:// is no known database: give the path of a file, or postgres://USER@HOST/NAME"))
            }
        }
    }
}

impl fmt::Display for Location {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(file) => {
                let whole = std::path::absolute(file);
                whole.as_deref().unwrap_or(file).display().fmt(formatter)
            }
            Self::Memory => formatter.write_str("in memory"),
            Self::Server(server) => formatter.write_str(&server.shown),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scheme_decides_and_passwords_are_not_shown() {
        assert!(matches!("data/p.db".parse(), Ok(Location::File(file)) if file == Path::new("data/p.db")));
        assert!(matches!("sqlite://p.db".parse(), Ok(Location::File(file)) if file == Path::new("p.db")));
        let server: Location = "postgres://lab:secret@db.example:5433/grades?sslpassword=hush".parse().unwrap();
        assert_eq!(server.to_string(), "postgres://lab@db.example:5433/grades");
        assert!("mysql://x".parse::<Location>().unwrap_err().contains("postgres://"));
    }
}
