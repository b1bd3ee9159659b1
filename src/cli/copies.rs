//! `plumbline backup`, `restore`, `export` and `import`: the database as a file, as files of lines, and back again.

use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader, BufWriter, Lines, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;

use super::database;
use crate::store::copies::{Contents, copy, inspect};
use crate::store::secrets::Secrets;
use crate::store::transfer::export;
use crate::store::transfer_tables::{KINDS, Kind};

/// Arguments of `backup` and `restore`.
#[derive(Debug, Args)]
pub struct CopyArgs {
    /// The copy.
    file: PathBuf,
    /// The service's database.
    #[arg(long, env = "PLUMBLINE_DATABASE", default_value = "plumbline.db")]
    database: PathBuf,
    /// Copy the keys too, of epochs and of receipts: the folder FILE.secrets. Whoever has it can draw what is still hidden.
    #[arg(long)]
    with_secrets: bool,
}

/// Arguments of `restore`.
#[derive(Debug, Args)]
pub struct RestoreArgs {
    #[command(flatten)]
    copy: CopyArgs,
    /// Only say what would be done.
    #[arg(long)]
    dry_run: bool,
}

/// Arguments of `export` and `import`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Folder of `runs.ndjson`, `submissions.ndjson`, `reports.ndjson` and the other files.
    folder: PathBuf,
    /// The service's database.
    #[arg(long, env = "PLUMBLINE_DATABASE", default_value = "plumbline.db")]
    database: PathBuf,
}

/// Writes a consistent copy, while the service runs or not.
///
/// # Errors
/// Where the copy exists already, or cannot be written.
pub fn back_up(args: &CopyArgs) -> anyhow::Result<ExitCode> {
    must_exist(&args.database)?;
    database::name(&args.database);
    let contents = copy_checked(&args.database, &args.file)?;
    if args.with_secrets {
        Secrets::beside(&args.database).copy_to(&Secrets::beside(&args.file))?;
    }
    tell("backed up to", &args.file, contents);
    Ok(ExitCode::SUCCESS)
}

/// Puts a copy where the service's database shall be. The service must not run; a database that is there stays.
///
/// # Errors
/// Where there is a database already, or the copy is damaged or another program's.
pub fn restore(args: &RestoreArgs) -> anyhow::Result<ExitCode> {
    let RestoreArgs { copy: args, dry_run } = args;
    let (from, to) = (args.file.display(), std::path::absolute(&args.database)?);
    let keys = Secrets::beside(&args.file);
    println!("restores {from} to {}", to.display());
    if args.with_secrets && !keys.folder().is_dir() {
        bail!("there are no keys beside {from}: it was made without --with-secrets");
    }
    match (args.with_secrets, keys.folder().exists()) {
        (true, _) => println!("with the keys in {}", keys.folder().display()),
        (false, true) => println!("without the keys in {}; --with-secrets takes them along", keys.folder().display()),
        (false, false) => {
            println!("without keys: open epochs close, and receipts are signed with a new key, which their log says");
        }
    }
    must_exist(&args.file)?;
    let beside = |ending: &str| PathBuf::from(format!("{}{ending}", args.database.display()));
    for left in [args.database.clone(), beside("-wal"), beside("-shm")] {
        if left.exists() {
            bail!("{} is there; move it away first (and stop the service)", left.display());
        }
    }
    let contents = run(inspect(&args.file))?.with_context(|| args.file.display().to_string())?;
    if *dry_run {
        tell("nothing was changed; it would hold", &args.file, contents);
        return Ok(ExitCode::SUCCESS);
    }
    if args.with_secrets {
        Secrets::beside(&args.file).copy_to(&Secrets::beside(&args.database))?;
    }
    let contents = copy_checked(&args.file, &args.database)?;
    tell("restored to", &args.database, contents);
    Ok(ExitCode::SUCCESS)
}

/// Writes runs, submissions, reports and what else boards are made of as files of lines.
///
/// # Errors
/// Where a file exists already or cannot be written.
pub fn export_lines(args: &ExportArgs) -> anyhow::Result<ExitCode> {
    must_exist(&args.database)?;
    database::name(&args.database);
    std::fs::create_dir_all(&args.folder).with_context(|| args.folder.display().to_string())?;
    let mut files = Vec::new();
    for kind in KINDS {
        let path = lines_file(&args.folder, kind);
        let file = OpenOptions::new().write(true).create_new(true).open(&path);
        let place = || format!("{} cannot be made; export into a folder that has no export yet", path.display());
        files.push((BufWriter::new(file.with_context(place)?), path.clone(), 0_u64));
    }
    let write = |kind: &'static Kind, line: &str| {
        let at = KINDS.iter().position(|known| known.name == kind.name).unwrap_or_default();
        let (file, _, lines) = &mut files[at];
        *lines += 1;
        writeln!(file, "{line}")
    };
    run(export(&args.database, write))??;
    for (file, path, lines) in files {
        file.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()?;
        println!("{}: {lines} lines", path.display());
    }
    Ok(ExitCode::SUCCESS)
}

fn lines_file(folder: &Path, kind: &Kind) -> PathBuf {
    folder.join(format!("{}.ndjson", kind.name))
}

/// Reads such files into a database that has no runs yet: the same boards, on another machine.
///
/// # Errors
/// Where the database is not empty, or a line does not fit; then nothing was stored.
pub fn import_lines(args: &ExportArgs) -> anyhow::Result<ExitCode> {
    let is_missing = |kind: &&Kind| !lines_file(&args.folder, kind).is_file();
    let missing: Vec<String> = KINDS.iter().filter(is_missing).map(|kind| format!("{}.ndjson", kind.name)).collect();
    if !missing.is_empty() {
        bail!("{} holds no whole export: {} missing", args.folder.display(), missing.join(", "));
    }
    run(async {
        let store = database::open(&args.database).await?;
        let lines = |kind: &'static Kind| -> std::io::Result<Option<Lines<BufReader<File>>>> {
            match File::open(lines_file(&args.folder, kind)) {
                Ok(file) => Ok(Some(BufReader::new(file).lines())),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
                Err(error) => Err(error),
            }
        };
        let counts = store.import(lines).await;
        store.close().await;
        for (name, count) in counts? {
            println!("{name}: {count}");
        }
        Ok(ExitCode::SUCCESS)
    })?
}

/// Copies beside the target, looks through the copy, and only then gives it its name.
fn copy_checked(from: &Path, to: &Path) -> anyhow::Result<Contents> {
    if to.exists() {
        bail!("{} is there already", to.display());
    }
    let partial = PathBuf::from(format!("{}.partial", to.display()));
    if partial.exists() {
        std::fs::remove_file(&partial).with_context(|| partial.display().to_string())?;
    }
    run(copy(from, &partial))?.with_context(|| format!("{} to {}", from.display(), to.display()))?;
    let contents = run(inspect(&partial))?.with_context(|| partial.display().to_string())?;
    File::open(&partial)?.sync_all()?;
    std::fs::rename(&partial, to).with_context(|| to.display().to_string())?;
    let folder = to.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()?;
    Ok(contents)
}

fn must_exist(file: &Path) -> anyhow::Result<()> {
    if !file.is_file() {
        bail!("there is no file {}", file.display());
    }
    Ok(())
}

fn tell(what: &str, file: &Path, contents: Contents) {
    let Contents { runs, submissions, reports } = contents;
    println!("{what} {}: {runs} runs, {submissions} submissions, {reports} reports", file.display());
}

fn run<T>(work: impl Future<Output = T>) -> anyhow::Result<T> {
    Ok(tokio::runtime::Builder::new_current_thread().enable_all().build()?.block_on(work))
}
