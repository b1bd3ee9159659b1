//! Migrations in the binary: the files of `migrations/` at build time, a folder for each database.

use std::sync::LazyLock;

use rust_embed::RustEmbed;
use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};

#[derive(RustEmbed)]
#[folder = "migrations/sqlite/"]
struct ForSqlite;

#[derive(RustEmbed)]
#[folder = "migrations/postgres/"]
struct ForPostgres;

/// Migrator that brings a SQLite file up to date. Versions and descriptions come from file names such as
/// `0001_initial.sql`.
pub(super) static SQLITE: LazyLock<Migrator> = LazyLock::new(migrator::<ForSqlite>);

/// Migrator that brings a PostgreSQL database up to date.
pub(super) static POSTGRES: LazyLock<Migrator> = LazyLock::new(migrator::<ForPostgres>);

fn migrator<Files: RustEmbed>() -> Migrator {
    let mut migrations: Vec<Migration> = Files::iter().filter_map(|name| migration::<Files>(&name)).collect();
    migrations.sort_by_key(|migration| migration.version);
    Migrator { migrations: migrations.into(), ..Migrator::DEFAULT }
}

/// Returns the migration in a file; none if the file is not a migration.
fn migration<Files: RustEmbed>(name: &str) -> Option<Migration> {
    let (version, description) = name.strip_suffix(".sql")?.split_once('_')?;
    let file = Files::get(name)?;
    let sql = String::from_utf8(file.data.into_owned()).expect("migrations are UTF-8, as a test shows");
    let version = version.parse().ok()?;
    Some(Migration::new(
        version,
        description.replace('_', " ").into(),
        MigrationType::Simple,
        sqlx::AssertSqlSafe(sql).into_sql_str(),
        false,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_is_a_migration_and_their_numbers_have_no_gap() {
        for (migrator, files) in [(&*SQLITE, ForSqlite::iter().count()), (&*POSTGRES, ForPostgres::iter().count())] {
            let versions: Vec<i64> = migrator.iter().map(|migration| migration.version).collect();
            assert_eq!(versions, (1..=i64::try_from(files).unwrap()).collect::<Vec<_>>());
        }
    }
}
