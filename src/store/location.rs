//! Where a database is: a SQLite file, or a PostgreSQL server.

use std::convert::Infallible;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sqlx::postgres::PgConnectOptions;

use plumbline_engine::text::nearest;

/// Location of a database. It prints without the password.
#[derive(Debug, Clone)]
pub enum Location {
    /// No database: what a node that only grades needs is in memory.
    Memory,
    /// Text that names no database, with the reason. The text itself may hold a password and is not kept.
    Unreadable(String),
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
            Self::Memory | Self::Unreadable(_) | Self::Server(_) => None,
        }
    }

    /// Returns the server, if the database is on one.
    #[must_use]
    pub fn server(&self) -> Option<&Server> {
        match self {
            Self::Server(server) => Some(server),
            Self::Memory | Self::Unreadable(_) | Self::File(_) => None,
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
            Self::Memory | Self::Unreadable(_) | Self::Server(_) => "plumbline.secrets".into(),
        }
    }
}

impl From<PathBuf> for Location {
    fn from(file: PathBuf) -> Self {
        Self::File(file)
    }
}

impl FromStr for Location {
    type Err = Infallible;

    /// Reads the name of a database. A name that cannot be read is told when the database is opened, without repeating
    /// it, because it may hold a password; only the name of a folder is repeated.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        let unreadable = |why: &str| Ok(Self::Unreadable(why.to_owned()));
        let Some((scheme, rest)) = text.split_once("://") else {
            return match text {
                "" => unreadable("is empty: give the path of a file, or postgres://USER@HOST/NAME"),
                _ if text.contains("password=") || text.starts_with("postgres:") => {
                    unreadable("expected the path of a file, or a URL: postgres://USER@HOST/NAME")
                }
                _ => Ok(file_at(text)),
            };
        };
        match scheme.to_ascii_lowercase().as_str() {
            "postgres" | "postgresql" => match PgConnectOptions::from_str(&format!("postgres://{rest}")) {
                Ok(_) if let Some(why) = misspelt_parameter(rest) => Ok(Self::Unreadable(why)),
                // What follows the first slash is no name then, but the rest of a password.
                Ok(_) if has_at_in_name(rest) => unreadable(NOT_A_URL),
                Ok(options) => Ok(Self::Server(Box::new(Server { options, shown: without_password(rest) }))),
                Err(_) => unreadable(NOT_A_URL),
            },
            "sqlite" | "file" => Ok(file_at(rest)),
            _ => unreadable("no known database: give the path of a file, or postgres://USER@HOST/NAME"),
        }
    }
}

/// Returns the location of a file, which is no folder.
fn file_at(path: &str) -> Location {
    if Path::new(path).is_dir() {
        return Location::Unreadable(format!("{path} is a folder: name a file in it"));
    }
    Location::File(path.into())
}

/// What is said of a URL that cannot be read, without its text.
const NOT_A_URL: &str = "not a PostgreSQL URL, postgres://USER:PASSWORD@HOST:PORT/NAME: percent-encode what is special in the \
                         password (/ is %2F, @ is %40, : is %3A, # is %23, ? is %3F). A socket is \
                         postgres://USER@localhost/NAME?host=/run/postgresql";

/// Parameters of a PostgreSQL URL.
const PARAMETERS: [&str; 18] = [
    "sslmode",
    "ssl-mode",
    "ssl-root-cert",
    "ssl-ca",
    "ssl-cert",
    "ssl-key",
    "sslrootcert",
    "sslcert",
    "sslkey",
    "host",
    "hostaddr",
    "port",
    "dbname",
    "user",
    "password",
    "application_name",
    "options",
    "statement-cache-capacity",
];

/// Greatest number of slips in a misspelt parameter.
const SLIPS: usize = 2;

/// Says which parameter of a URL is misspelt, if one is: without `sslmode` the connection would have no TLS. Parameters of
/// other clients are left alone. Says nothing else of the URL, which may hold a password.
fn misspelt_parameter(rest: &str) -> Option<String> {
    let (_, query) = rest.split_once('?')?;
    form_urlencoded::parse(query.as_bytes()).find_map(|(name, _)| {
        if PARAMETERS.contains(&&*name) || name.starts_with("options[") {
            return None;
        }
        let meant = nearest(&name, PARAMETERS, |own| SLIPS.min(own.len() / 3))?;
        Some(format!("the URL postgres://… has no parameter {name:?}; did you mean {meant}?"))
    })
}

/// Returns whether an @ follows the first slash: it is that of a password with a slash.
fn has_at_in_name(rest: &str) -> bool {
    let rest = rest.split('?').next().unwrap_or_default();
    rest.split_once('/').is_some_and(|(_, name)| name.contains('@'))
}

/// Returns the URL of what follows `postgres://`, without its password and its parameters, which may hold one.
fn without_password(rest: &str) -> String {
    // In a URL that can be read, a question mark begins the parameters.
    let rest = rest.split('?').next().unwrap_or_default();
    let (authority, name) = rest.split_once('/').unwrap_or((rest, ""));
    let (who, place) = authority.rsplit_once('@').unwrap_or(("", authority));
    let who = who.split(':').next().unwrap_or_default();
    let at = if who.is_empty() { "" } else { "@" };
    format!("postgres://{who}{at}{place}/{name}")
}

impl fmt::Display for Location {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(file) => {
                let whole = std::path::absolute(file);
                whole.as_deref().unwrap_or(file).display().fmt(formatter)
            }
            Self::Memory => formatter.write_str("in memory"),
            Self::Unreadable(_) => formatter.write_str("(unreadable)"),
            Self::Server(server) => formatter.write_str(&server.shown),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_parameter_is_no_connection_without_tls() {
        for query in [
            "sslmode=verify-full&options=-c%20x=1",
            "ssl-mode=require&ssl-ca=/x",
            "options[search_path]=x&connect_timeout=3&channel_binding=require",
            "host=/run/postgresql",
            "password=ab&cdSecret",
        ] {
            assert!(matches!(format!("postgres://a@b/c?{query}").parse(), Ok(Location::Server(_))), "{query}");
        }
        for (query, named) in [
            ("sslmod=verify-full", "\"sslmod\"; did you mean sslmode?"),
            ("sslMode=require", "\"sslMode\"; did you mean sslmode?"),
            ("a=1&ssl_mode=require", "\"ssl_mode\"; did you mean ssl-mode?"),
        ] {
            let Ok(Location::Unreadable(why)) = format!("postgres://a@b/c?{query}").parse() else { panic!("{query}") };
            assert!(why.ends_with(named), "{query}: {why}");
        }
    }

    #[test]
    fn the_scheme_decides_and_passwords_are_not_shown() {
        assert!(matches!("data/p.db".parse(), Ok(Location::File(file)) if file == Path::new("data/p.db")));
        assert!(matches!("sqlite://p.db".parse(), Ok(Location::File(file)) if file == Path::new("p.db")));
        let server: Location = "postgres://lab:secret@db.example:5433/grades?password=hush".parse().unwrap();
        assert_eq!(server.to_string(), "postgres://lab@db.example:5433/grades");
        for hidden in ["lab@db?password=p@q", "lab@db?password=a/b", "db?user=lab&password=p@q", "lab@db/?password=x"] {
            let server: Location = format!("postgres://{hidden}").parse().unwrap();
            assert!(
                matches!(&server, Location::Server(_)) && !server.to_string().contains(['=', '?', 'q']),
                "{server}"
            );
        }
        let server: Location = "Postgres://lab:se@cret@db.example/grades".parse().unwrap();
        assert_eq!(server.to_string(), "postgres://lab@db.example/grades");
        for text in [
            "mysql://lab:secret@x/y",
            "postgres://lab:se/cret@x/y",
            "postgres://lab:p@secret/w@db/x",
            "host=x password=secret",
            "postgres:/x",
            "",
        ] {
            let Ok(Location::Unreadable(why)) = text.parse() else { panic!("{text}") };
            assert!(!why.contains("secret") && why.contains("postgres://"), "{text}: {why}");
        }
    }
}
