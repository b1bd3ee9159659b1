//! `plumbline backup`, `restore`, `export` and `import`: copy the database to a file or to files of JSON lines, and
//! back.

use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader, BufWriter, Lines, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;

use super::checksums;
use super::database::DatabaseArgs;
use super::process::block_on;
use super::witness::folder_of;
use crate::app::submissions::decision::lane_of;
use crate::store::secrets::Secrets;
use crate::store::serving::Serving;
use crate::store::sqlite::copies::{Contents, copy, inspect};
use crate::store::transfer::export;
use crate::store::transfer_tables::{KINDS, Kind};
use plumbline_engine::text::counted;

/// Remedy where a command copies files and the database is on a server.
const NO_BACKUP: &str = "backup and restore copy a file; back up PostgreSQL with pg_dump, and the folder of secrets with \
                         it (docs/operations.md says how); `plumbline export` works on both";

/// Arguments of `backup` and `restore`.
#[derive(Debug, Args)]
pub struct CopyArgs {
    /// Backup file.
    file: PathBuf,
    #[command(flatten)]
    database: DatabaseArgs,
    /// Include the keys of epochs and receipts, in the folder FILE.secrets. Anyone who has it can draw what is
    /// still hidden.
    #[arg(long)]
    with_secrets: bool,
}

/// Arguments of `restore`.
#[derive(Debug, Args)]
pub struct RestoreArgs {
    #[command(flatten)]
    copy: CopyArgs,
    /// Print what would be done, without doing it.
    #[arg(long)]
    dry_run: bool,
}

/// Arguments of `export` and `import`.
#[derive(Debug, Args)]
pub struct LinesArgs {
    /// Folder of the exported files: `runs.ndjson`, `submissions.ndjson`, `reports.ndjson` and others.
    folder: PathBuf,
    #[command(flatten)]
    database: DatabaseArgs,
}

/// Writes a consistent copy, whether or not the service runs.
///
/// # Errors
/// Returns an error if the database does not exist, or the copy already exists or cannot be written.
pub fn back_up(args: &CopyArgs) -> anyhow::Result<ExitCode> {
    let database = args.database.file(NO_BACKUP)?;
    must_exist(database)?;
    args.database.name();
    let kept = args.database.kept_secrets();
    if args.with_secrets && !kept.has_signer()? {
        bail!("there is no receipts.key in {}: name the folder of the keys with --secrets", kept.folder().display());
    }
    let checksums = checksums_of(&args.file);
    // A checksum file without its backup belongs to a deleted backup, and would contradict the new one.
    if checksums.exists() && !args.file.exists() {
        std::fs::remove_file(&checksums).with_context(|| checksums.display().to_string())?;
    }
    let contents = copy_checked(database, &args.file)?;
    checksums::write(&checksums, &checksums::line(&args.file)?)?;
    if args.with_secrets {
        kept.copy_to(&Secrets::beside(&args.file))?;
    }
    tell("backed up to", &args.file, &contents);
    if let Some(place) = contents.blobs {
        println!("its large logs and reports are in {place}: back that up too, now, after the database");
    }
    Ok(ExitCode::SUCCESS)
}

/// Returns the file with the checksum of a backup.
fn checksums_of(backup: &Path) -> PathBuf {
    PathBuf::from(format!("{}.sha256", backup.display()))
}

/// Restores the database from a copy. The service must not run, and an existing database is never overwritten.
///
/// # Errors
/// Returns an error if a database already exists, or the copy is damaged or belongs to another program.
pub fn restore(args: &RestoreArgs) -> anyhow::Result<ExitCode> {
    let RestoreArgs { copy: args, dry_run } = args;
    let database = args.database.file(NO_BACKUP)?;
    let (from, to) = (args.file.display(), std::path::absolute(database)?);
    let keys = Secrets::beside(&args.file);
    must_exist(&args.file)?;
    let beside = |ending: &str| PathBuf::from(format!("{}{ending}", database.display()));
    for left in [database.to_owned(), beside("-wal"), beside("-shm")] {
        if left.exists() {
            bail!("{} already exists; move it away first (and stop the service)", left.display());
        }
    }
    if beside(".lock").exists() && Serving::of(database)?.is_shared {
        bail!("a process serves {} still, although the file is gone: stop it first", database.display());
    }
    if args.with_secrets && !keys.folder().is_dir() {
        bail!("there are no keys beside {from}: the backup was made without --with-secrets");
    }
    if args.with_secrets {
        keys.must_fit(&args.database.kept_secrets())?;
    }
    let checksums = checksums_of(&args.file);
    if checksums.exists() {
        checksums::verify(&checksums, &[&args.file])?;
    } else {
        println!("there is no {}: bytes that were changed since the backup may go unnoticed", checksums.display());
    }
    let contents = run(inspect(&args.file))?.with_context(|| args.file.display().to_string())?;
    println!("restoring {from} to {}", to.display());
    let kept = args.database.kept_secrets();
    match (args.with_secrets, keys.folder().exists()) {
        (true, _) => println!("with the keys in {}", keys.folder().display()),
        (false, true) => {
            println!("without the keys in {}; --with-secrets includes them", keys.folder().display());
            if kept.has_signer()? {
                println!("the keys in {} stay as they are", kept.folder().display());
            }
        }
        _ if kept.has_signer()? => println!("the keys in {} stay as they are", kept.folder().display()),
        (false, false) => println!(
            "without keys: no epoch issues or reveals anything, and the service does not start until --secrets names the folder \
             that has receipts.key. Only if that is lost, start with --new-receipt-key, which the log of receipts notes"
        ),
    }
    if *dry_run {
        tell("nothing was changed; would restore", &args.file, &contents);
        return Ok(ExitCode::SUCCESS);
    }
    if args.with_secrets {
        Secrets::beside(&args.file).copy_to(&args.database.kept_secrets())?;
    }
    let contents = copy_checked(&args.file, database)?;
    tell("restored to", database, &contents);
    println!(
        "if the service accepted anything after this backup, its log of receipts is now shorter than witnesses may have seen \
         it, and they will say so: tell them before you start it"
    );
    if kept.has_signer()? {
        println!(
            "then give it a new key too, so that both histories can be told apart: move receipts.key out of {} and keep it, \
             and start with serve --new-receipt-key",
            kept.folder().display()
        );
    }
    if let Some(place) = contents.blobs {
        println!("its large logs and reports are in {place}, which must be there with all that the backup refers to");
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes runs, submissions, reports and all other board data as files of JSON lines.
///
/// # Errors
/// Returns an error if the database does not exist, or a file already exists or cannot be written.
pub fn export_lines(args: &LinesArgs) -> anyhow::Result<ExitCode> {
    args.database.name();
    std::fs::create_dir_all(&args.folder).with_context(|| args.folder.display().to_string())?;
    let unfinished = args.folder.join(UNFINISHED);
    let lines = KINDS.iter().map(|kind| lines_file(&args.folder, kind));
    for there in lines.chain([args.folder.join(CHECKSUMS), unfinished.clone()]) {
        if there.exists() {
            bail!("{} is there; export into a folder that holds no export yet", there.display());
        }
    }
    File::create_new(&unfinished).with_context(|| unfinished.display().to_string())?;
    let mut files = Vec::new();
    for kind in KINDS {
        let path = lines_file(&args.folder, kind);
        let file = OpenOptions::new().write(true).create_new(true).open(&path);
        let place = || format!("cannot create {}; export into a folder that holds no export yet", path.display());
        files.push((BufWriter::new(file.with_context(place)?), path.clone(), 0_u64));
    }
    let write = |kind: &'static Kind, line: &str| {
        let at = KINDS.iter().position(|known| known.name == kind.name).expect("only kinds of the list are exported");
        let (file, _, lines) = &mut files[at];
        *lines += 1;
        writeln!(file, "{line}")
    };
    if let Err(error) = run(export(&args.database.database, write))? {
        // Half an export must not look like a whole one.
        for (_, path, _) in &files {
            let _ = std::fs::remove_file(path);
        }
        let _ = std::fs::remove_file(&unfinished);
        return Err(error.into());
    }
    let mut checksums = String::new();
    for (file, path, lines) in files {
        file.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()?;
        println!("{}: {}", path.display(), counted(lines, "line"));
        checksums += &checksums::line(&path)?;
    }
    checksums::write(&args.folder.join(CHECKSUMS), &checksums)?;
    std::fs::remove_file(&unfinished)?;
    Ok(ExitCode::SUCCESS)
}

/// Name of the file with the checksums of an export, which is written last.
const CHECKSUMS: &str = "SHA256SUMS";
/// Name of the file that is there while an export is being written.
const UNFINISHED: &str = "SHA256SUMS.unfinished";

fn lines_file(folder: &Path, kind: &Kind) -> PathBuf {
    folder.join(format!("{}.ndjson", kind.name))
}

/// Imports exported files into a database that has no runs yet, which gives the same boards on another machine.
///
/// # Errors
/// Returns an error if a file is missing, the database is not empty, or a line is invalid; nothing is stored then.
pub fn import_lines(args: &LinesArgs) -> anyhow::Result<ExitCode> {
    let is_missing = |kind: &&Kind| !lines_file(&args.folder, kind).is_file();
    let missing: Vec<String> = KINDS.iter().filter(is_missing).map(|kind| format!("{}.ndjson", kind.name)).collect();
    if !missing.is_empty() {
        bail!("{} holds no complete export: {} missing", args.folder.display(), missing.join(", "));
    }
    if args.folder.join(UNFINISHED).exists() {
        bail!("{} holds an export that was interrupted ({UNFINISHED} is there): export again", args.folder.display());
    }
    let checksums = args.folder.join(CHECKSUMS);
    if checksums.exists() {
        let files: Vec<PathBuf> = KINDS.iter().map(|kind| lines_file(&args.folder, kind)).collect();
        checksums::verify(&checksums, &files.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    } else {
        println!("there is no {}: lines that were lost may go unnoticed", checksums.display());
    }
    run(async {
        let store = args.database.open().await?;
        let lines = |kind: &'static Kind| -> std::io::Result<Option<Lines<BufReader<File>>>> {
            match File::open(lines_file(&args.folder, kind)) {
                Ok(file) => Ok(Some(BufReader::new(file).lines())),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
                Err(error) => Err(error),
            }
        };
        let counts = store.import(lines, lane_of).await;
        store.close().await;
        for (name, count) in counts? {
            println!("{name}: {count}");
        }
        Ok(ExitCode::SUCCESS)
    })?
}

/// Copies to a file beside the target, inspects the copy, and only then renames it to the target.
fn copy_checked(from: &Path, to: &Path) -> anyhow::Result<Contents> {
    if to.exists() {
        bail!("{} already exists", to.display());
    }
    let partial = PathBuf::from(format!("{}.partial", to.display()));
    if partial.exists() {
        std::fs::remove_file(&partial).with_context(|| partial.display().to_string())?;
    }
    let made = run(copy(from, &partial))?.with_context(|| format!("{} to {}", from.display(), to.display()));
    let made = made.and_then(|()| run(inspect(&partial))?.with_context(|| partial.display().to_string()));
    if made.is_err() {
        // An incomplete copy would only be in the way. If deleting it fails, the first error is the one to report.
        let _ = std::fs::remove_file(&partial);
    }
    let contents = made?;
    File::open(&partial)?.sync_all()?;
    std::fs::rename(&partial, to).with_context(|| to.display().to_string())?;
    File::open(folder_of(to))?.sync_all()?;
    Ok(contents)
}

fn must_exist(file: &Path) -> anyhow::Result<()> {
    if !file.is_file() {
        bail!("there is no file {}", file.display());
    }
    Ok(())
}

fn tell(what: &str, file: &Path, contents: &Contents) {
    let Contents { runs, submissions, reports, blobs: _ } = contents;
    let told = [(*runs, "run"), (*submissions, "submission"), (*reports, "report")].map(|(n, thing)| counted(n, thing));
    println!("{what} {}: {}", file.display(), told.join(", "));
}

/// Runs work on this thread and returns its result, an error or not.
///
/// # Errors
/// Returns an error if the runtime cannot be made.
fn run<T>(work: impl Future<Output = T>) -> anyhow::Result<T> {
    block_on(async { Ok(work.await) })
}
