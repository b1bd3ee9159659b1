//! The database that a command works on: named before anything is done to it, and never made by accident.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;

use crate::store::{Store, schema};

/// Opens a database that is there, and says which it is.
///
/// # Errors
/// Where there is none, it is of another version, or it cannot be opened.
pub async fn open(file: &Path) -> anyhow::Result<Store> {
    name(file);
    Ok(Store::open_existing(file).await?)
}

/// Says on standard error which file is worked on.
pub fn name(file: &Path) {
    let whole = std::path::absolute(file);
    eprintln!("database {}", whole.as_deref().unwrap_or(file).display());
}

/// Arguments of `migrate`.
#[derive(Debug, Args)]
pub struct MigrateArgs {
    /// The service's database. The service must not run.
    #[arg(long, env = "PLUMBLINE_DATABASE", default_value = "plumbline.db")]
    database: PathBuf,
    /// Only say what would be done.
    #[arg(long)]
    dry_run: bool,
    /// Make a new database where there is none.
    #[arg(long)]
    create: bool,
}

/// Brings a database's schema up to date. A copy is made first, beside it.
///
/// # Errors
/// Where there is no database, or it is of a newer program.
pub fn migrate(args: &MigrateArgs) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        name(&args.database);
        let before = schema::state(&args.database).await?;
        before.must_not_be_newer(&args.database)?;
        let is_new = !before.is_there && args.create;
        if is_new && !args.dry_run {
            Store::open(&args.database).await?.close().await;
            println!("made with schema {}", before.known);
            return Ok(ExitCode::SUCCESS);
        }
        if !is_new && !before.is_there {
            before.must_be_current(&args.database)?;
        }
        if before.lacking.is_empty() {
            println!("schema {}, which is this program's: nothing to do", before.found);
            return Ok(ExitCode::SUCCESS);
        }
        println!("schema {}, to become {}:", before.found, before.known);
        for (version, what) in &before.lacking {
            println!("  {version:04} {what}");
        }
        if args.dry_run {
            println!("nothing was changed");
            return Ok(ExitCode::SUCCESS);
        }
        if let Some(copy) = schema::migrate(&args.database).await? {
            println!("done; as it was before it is kept as {}", copy.display());
        }
        Ok(ExitCode::SUCCESS)
    })
}
