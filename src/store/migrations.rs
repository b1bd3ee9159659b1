//! Migrations in the binary: the files of `migrations/` at build time.

use std::sync::LazyLock;

use rust_embed::RustEmbed;
use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};

#[derive(RustEmbed)]
#[folder = "migrations/"]
struct Files;

/// Migrator that brings a database up to date. Versions and descriptions come from file names such as
/// `0001_initial.sql`.
pub(super) static MIGRATOR: LazyLock<Migrator> = LazyLock::new(|| {
    let mut migrations: Vec<Migration> = Files::iter().filter_map(|name| migration(&name)).collect();
    migrations.sort_by_key(|migration| migration.version);
    Migrator { migrations: migrations.into(), ..Migrator::DEFAULT }
});

/// Returns the migration in a file; none if the file is not a migration.
fn migration(name: &str) -> Option<Migration> {
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
        let versions: Vec<i64> = MIGRATOR.iter().map(|migration| migration.version).collect();
        let files = i64::try_from(Files::iter().count()).unwrap();
        assert_eq!(versions, (1..=files).collect::<Vec<_>>());
    }
}
