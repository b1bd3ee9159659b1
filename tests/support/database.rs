//! Databases of tests: a SQLite file, or with `PLUMBLINE_TEST_BACKEND=postgres` a database of a PostgreSQL server that
//! the tests start themselves.
//!
//! Tests name a database by the path of a file, whatever the backend. On PostgreSQL the path stands for a database of
//! its own, which is created when it is first named.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use plumbline::store::db::Pool;

use super::cluster::Cluster;

/// Whether the tests run on PostgreSQL.
pub fn is_postgres() -> bool {
    std::env::var("PLUMBLINE_TEST_BACKEND").is_ok_and(|backend| backend == "postgres")
}

/// Returns the arguments that name a database to the program.
pub fn named(path: &Path) -> Vec<OsString> {
    if !is_postgres() {
        return vec!["--database".into(), path.into()];
    }
    let mut secrets = path.as_os_str().to_owned();
    secrets.push(".secrets");
    vec!["--database".into(), url(path).into(), "--secrets".into(), secrets]
}

/// Returns the URL of the PostgreSQL database that a path stands for.
pub fn url(path: &Path) -> String {
    static KNOWN: Mutex<BTreeMap<PathBuf, String>> = Mutex::new(BTreeMap::new());
    let cluster = Cluster::shared();
    let mut known = KNOWN.lock().unwrap();
    let next = known.len();
    let name = known.entry(path.to_owned()).or_insert_with(|| {
        let name = format!("t{}_{next}", std::process::id());
        cluster.create(&name);
        name
    });
    cluster.url(name)
}

/// Copies a database that nobody uses, with its secrets, as an operator does to try something.
pub fn copied(from: &Path, to: &Path) {
    let secrets = |path: &Path| path.with_extension("db.secrets");
    let done = std::process::Command::new("cp").arg("-r").arg(secrets(from)).arg(secrets(to)).status().unwrap();
    assert!(done.success());
    if !is_postgres() {
        std::fs::copy(from, to).unwrap();
        return;
    }
    let name = |path: &Path| url(path).rsplit('/').next().unwrap().to_owned();
    let cluster = Cluster::shared();
    cluster.drop_database(&name(to));
    cluster.copy(&name(from), &name(to));
}

/// Connects to a database to look at its tables, or to change them behind the service's back.
pub async fn pool(path: &Path) -> Pool {
    if is_postgres() {
        return Pool::Postgres(sqlx::PgPool::connect(&url(path)).await.unwrap());
    }
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(path);
    Pool::Sqlite { pool: sqlx::SqlitePool::connect_with(options).await.unwrap(), file: None }
}
