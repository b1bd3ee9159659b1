//! The database that a command works on. Commands print its path before they touch it and never create it by accident.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::bail;
use clap::Args;
use clap::builder::BoolishValueParser;

use super::process::block_on;
use crate::app::signing::refuse_to_begin_anew;
use crate::store::blobs::{BlobPlace, place_of};
use crate::store::location::Location;
use crate::store::moving::{Moved, Purpose, move_to};
use crate::store::secrets::Secrets;
use crate::store::{Store, StoreError, schema};

/// Arguments of every command that works on the database of a service.
#[derive(Debug, Clone, Args)]
pub struct DatabaseArgs {
    /// Database of the service: a file, or the URL of a PostgreSQL database (`postgres://USER@HOST/NAME`).
    #[arg(
        long,
        global = true,
        env = "PLUMBLINE_DATABASE",
        hide_env_values = true,
        value_name = "FILE|URL",
        default_value = "plumbline.db"
    )]
    pub database: Location,
    /// Folder of the keys of epochs and receipts; by default FILE.secrets, or plumbline.secrets for PostgreSQL. All
    /// nodes of a service need the same.
    #[arg(long, global = true, env = "PLUMBLINE_SECRETS", value_name = "FOLDER")]
    pub secrets: Option<PathBuf>,
}

/// Argument of nodes, beside those of [`DatabaseArgs`].
#[derive(Debug, Clone, Args)]
pub struct NoticeArgs {
    /// Do not listen for notices of other nodes on PostgreSQL, but look for jobs from time to time: for a pooler that
    /// shares sessions, such as `PgBouncer` in transaction mode.
    #[arg(long, env = "PLUMBLINE_NO_NOTICES", value_parser = BoolishValueParser::new())]
    pub no_notices: bool,
}

/// Argument of nodes: where large logs and reports are.
#[derive(Debug, Clone, Args)]
pub struct BlobArgs {
    /// Keep large logs and reports outside the database: in a folder that all nodes reach (`file:///srv/blobs`), or in a
    /// bucket of a server that speaks the protocol of S3 (`s3://BUCKET/PREFIX`). The database notes the place, so it is
    /// given once. Credentials of a bucket are read from `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY`, its server
    /// from `AWS_REGION` or `AWS_ENDPOINT`.
    #[arg(long, env = "PLUMBLINE_BLOBS", value_name = "URL")]
    pub blobs: Option<BlobPlace>,
}

impl DatabaseArgs {
    /// Opens an existing database and prints its location.
    ///
    /// # Errors
    /// Returns an error if the database does not exist, has another schema version, or cannot be opened.
    pub async fn open(&self) -> anyhow::Result<Store> {
        self.name();
        Ok(Store::open_existing(&self.database, self.secrets.clone()).await?)
    }

    /// Prints the location of the database on standard error: an absolute path, or a URL without its password.
    pub fn name(&self) {
        eprintln!("database {}", self.database);
    }

    /// Returns the secrets of the database.
    pub fn kept_secrets(&self) -> Secrets {
        Secrets::in_folder(self.secrets.clone().unwrap_or_else(|| self.database.default_secrets()))
    }

    /// Returns the file of the database.
    ///
    /// # Errors
    /// Returns an error with `instead`, the remedy, if the database is on a server.
    pub fn file(&self, instead: &'static str) -> Result<&Path, StoreError> {
        match &self.database {
            Location::Unreadable(why) => Err(StoreError::Unreadable(why.clone())),
            database => database.file().ok_or(StoreError::OnlyFiles(instead)),
        }
    }
}

/// Arguments of `migrate`.
#[derive(Debug, Args)]
pub struct MigrateArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    /// Print what would be done, without doing it.
    #[arg(long)]
    dry_run: bool,
    /// Create the database if it does not exist.
    #[arg(long)]
    create: bool,
    /// SQLite file whose rows move into the empty PostgreSQL database given by --to. The service must not run, but may
    /// with --dry-run, which copies and compares everything and then takes it back.
    #[arg(long, value_name = "FILE", requires = "to", conflicts_with = "create")]
    from: Option<PathBuf>,
    /// PostgreSQL database that takes the rows of --from.
    #[arg(long, value_name = "URL", requires = "from")]
    to: Option<Location>,
}

/// Brings a database's schema up to date, after making a copy beside it.
///
/// # Errors
/// Returns an error if the database does not exist, was written by a newer program, or cannot be copied or changed.
pub fn migrate(args: &MigrateArgs) -> anyhow::Result<ExitCode> {
    if let (Some(from), Some(to)) = (&args.from, &args.to) {
        return block_on(move_rows(from, to, args.dry_run));
    }
    block_on(async {
        let location = &args.database.database;
        args.database.name();
        let before = schema::state(location).await?;
        before.must_not_be_newer(location)?;
        if before.found == 0 {
            refuse_to_begin_anew(location, args.database.secrets.as_deref()).await?;
        }
        let is_new = !before.is_there && args.create;
        if is_new && !args.dry_run {
            Store::open(location, args.database.secrets.clone()).await?.close().await;
            println!("created with schema {}", before.known);
            return Ok(ExitCode::SUCCESS);
        }
        if !is_new && !before.is_there {
            before.must_be_current(location)?;
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
        match schema::migrate(location).await? {
            Some(copy) => println!("done; the previous database is kept as {}", copy.display()),
            None => println!("done"),
        }
        Ok(ExitCode::SUCCESS)
    })
}

/// Moves the rows of a file to a server, and says what moved and what is left to do.
async fn move_rows(from: &Path, to: &Location, is_dry_run: bool) -> anyhow::Result<ExitCode> {
    if from.to_string_lossy().contains("://") {
        bail!("--from: expected a SQLite file, found a URL; rows move from a file to a server");
    }
    if from.is_dir() {
        bail!("--from: {} is a folder: name the database file in it", from.display());
    }
    let Ok(found) = std::fs::metadata(from) else { bail!("--from: there is no file {}", from.display()) };
    if found.len() == 0 {
        bail!("--from: {} is empty: is this the right file?", from.display());
    }
    let Some(server) = to.server() else { bail!("--to: expected the URL of a PostgreSQL database, found {to}") };
    let purpose = if is_dry_run { Purpose::Rehearse } else { Purpose::Move };
    let begun = Instant::now();
    let file = Location::File(from.to_owned());
    let blobs = place_of(&file).await?;
    for Moved { table, rows, sha256 } in Box::pin(move_to(from, server, purpose)).await? {
        println!("{table}: {rows} rows, the same in both (SHA-256 {sha256})");
    }
    if let Some((place, unreached)) = blobs {
        println!("large logs and reports stay in {place}, which all nodes must reach");
        if let Some(error) = unreached {
            eprintln!("warning: {error}; what is there cannot be graded or shown until it is back");
        }
    }
    if is_dry_run {
        println!(
            "a move would succeed: every row was copied and compared, and the receipts verify; it took {:.0?}",
            begun.elapsed()
        );
        println!("nothing was moved; {to} has the tables, and no rows");
        return Ok(ExitCode::SUCCESS);
    }
    let secrets = file.default_secrets();
    println!("done: every row is in {to}, and the receipts verify: none is missing, none was changed");
    if secrets.is_dir() {
        println!("give all nodes the folder of secrets, {}, with --secrets", secrets.display());
    } else {
        println!("give all nodes the folder of secrets of the service with --secrets; it is not {}", secrets.display());
    }
    println!(
        "move {} away now, and take it out of every unit and script: a service that starts on it goes on with the same key, \
         and its log of receipts and that of {to} become two histories",
        from.display()
    );
    Ok(ExitCode::SUCCESS)
}
