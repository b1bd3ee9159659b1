//! `plumbline backup`, `restore` and `export`: the database as a file, back again, and as files of lines.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;

use crate::store::copies::{Contents, Exported, copy, export, inspect};
use crate::store::secrets::Secrets;

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

/// Arguments of `export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Folder for `runs.ndjson`, `submissions.ndjson` and `reports.ndjson`; made where it is missing.
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
pub fn restore(args: &CopyArgs) -> anyhow::Result<ExitCode> {
    must_exist(&args.file)?;
    let beside = |ending: &str| PathBuf::from(format!("{}{ending}", args.database.display()));
    for left in [args.database.clone(), beside("-wal"), beside("-shm")] {
        if left.exists() {
            bail!("{} is there; move it away first (and stop the service)", left.display());
        }
    }
    run(inspect(&args.file))?.with_context(|| args.file.display().to_string())?;
    if args.with_secrets {
        Secrets::beside(&args.file).copy_to(&Secrets::beside(&args.database))?;
    }
    let contents = copy_checked(&args.file, &args.database)?;
    tell("restored to", &args.database, contents);
    Ok(ExitCode::SUCCESS)
}

/// Writes runs, submissions and reports as files of lines.
///
/// # Errors
/// Where a file exists already or cannot be written.
pub fn export_lines(args: &ExportArgs) -> anyhow::Result<ExitCode> {
    must_exist(&args.database)?;
    std::fs::create_dir_all(&args.folder).with_context(|| args.folder.display().to_string())?;
    let mut files = Vec::new();
    for kind in Exported::ALL {
        let path = args.folder.join(format!("{}.ndjson", kind.name()));
        let file = OpenOptions::new().write(true).create_new(true).open(&path);
        files.push((BufWriter::new(file.with_context(|| path.display().to_string())?), path, 0_u64));
    }
    let write = |kind: Exported, line: &serde_json::Value| {
        let at = Exported::ALL.iter().position(|known| *known == kind).unwrap_or_default();
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
