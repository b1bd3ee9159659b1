//! The database that a command works on. Commands print its path before they touch it and never create it by accident.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;

use crate::store::{Store, schema};

/// Opens an existing database and prints its path.
///
/// # Errors
/// Returns an error if the database does not exist, has another schema version, or cannot be opened.
pub async fn open(file: &Path) -> anyhow::Result<Store> {
    name(file);
    Ok(Store::open_existing(file).await?)
}

/// Prints the absolute path of the database file on standard error.
pub fn name(file: &Path) {
    let whole = std::path::absolute(file);
    eprintln!("database {}", whole.as_deref().unwrap_or(file).display());
}

/// Arguments of `migrate`.
#[derive(Debug, Args)]
pub struct MigrateArgs {
    /// Database file of the service, which must not be running.
    #[arg(long, env = "PLUMBLINE_DATABASE", default_value = "plumbline.db")]
    database: PathBuf,
    /// Print what would be done, without doing it.
    #[arg(long)]
    dry_run: bool,
    /// Create the database if it does not exist.
    #[arg(long)]
    create: bool,
}

/// Brings a database's schema up to date, after making a copy beside it.
///
/// # Errors
/// Returns an error if the database does not exist, was written by a newer program, or cannot be copied or changed.
pub fn migrate(args: &MigrateArgs) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        name(&args.database);
        let before = schema::state(&args.database).await?;
        before.must_not_be_newer(&args.database)?;
        let is_new = !before.is_there && args.create;
        if is_new && !args.dry_run {
            Store::open(&args.database).await?.close().await;
            println!("created with schema {}", before.known);
            return Ok(ExitCode::SUCCESS);
        }
        if !is_new && !before.is_there {
            before.must_be_current(&args.database)?;
        }
        if before.lacking.is_empty() {
            println!("schema {} is up to date: nothing to do", before.found);
            return Ok(ExitCode::SUCCESS);
        }
        println!("migrations from schema {} to {}:", before.found, before.known);
        for (version, what) in &before.lacking {
            println!("  {version:04} {what}");
        }
        if args.dry_run {
            println!("nothing was changed");
            return Ok(ExitCode::SUCCESS);
        }
        if let Some(copy) = schema::migrate(&args.database).await? {
            println!("done; the previous database is kept as {}", copy.display());
        }
        Ok(ExitCode::SUCCESS)
    })
}
