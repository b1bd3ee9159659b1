//! `plumbline tasks`: task files of others.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Subcommand;

use crate::clock::now_ms;
use crate::store::Store;
use crate::store::suites::SuiteStored;
use crate::tasks::published::{TaskFile, read_task_files};
use crate::tasks::{Suite, Task};

/// Commands on task files.
#[derive(Debug, Subcommand)]
pub enum TasksCommand {
    /// Read task files in the published format, check them, and add them to a database as a suite.
    Import {
        /// Task files (JSON).
        #[arg(required = true)]
        files: Vec<PathBuf>,
        /// Name and version of the suite that they make.
        #[arg(long, default_value = "imported@1")]
        suite: String,
        /// Database that takes the suite; without it the files are only checked.
        #[arg(long, env = "PLUMBLINE_DATABASE", value_name = "FILE")]
        database: Option<PathBuf>,
    },
}

/// Runs the command.
///
/// # Errors
/// Where a file cannot be read or has faults, all of them told.
pub fn run(command: TasksCommand) -> anyhow::Result<ExitCode> {
    let TasksCommand::Import { files, suite, database } = command;
    let (name, version) = parse_suite_id(&suite)?;
    let suite = Suite { name, version, tasks: read_files(&files)? };
    println!(
        "{} files, {} problems, {} check rows over {} entries",
        files.len(),
        suite.tasks.len(),
        suite.check_count(),
        suite.instruction_count()
    );
    match database {
        Some(database) => store(&suite, &database)?,
        None => println!("checked, not stored; --database FILE stores them as {}", suite.id()),
    }
    Ok(ExitCode::SUCCESS)
}

fn store(suite: &Suite, database: &Path) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let store = Store::open(database).await.with_context(|| database.display().to_string())?;
        let stored = store.put_suite(suite, now_ms()).await?;
        store.close().await;
        match stored {
            SuiteStored::Added => println!("stored as {}", suite.id()),
            SuiteStored::Unchanged => println!("{} was stored before, with the same content", suite.id()),
            SuiteStored::Conflict => {
                bail!("{} exists with another content; give a new version with --suite", suite.id())
            }
        }
        Ok(())
    })
}

fn read_files(files: &[PathBuf]) -> anyhow::Result<Vec<Task>> {
    let mut texts = Vec::with_capacity(files.len());
    for file in files {
        let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        texts.push((name, text));
    }
    let files: Vec<TaskFile<'_>> = texts.iter().map(|(name, text)| TaskFile { name, text }).collect();
    read_task_files(&files).map_err(|faults| {
        let told: Vec<String> = faults.iter().map(ToString::to_string).collect();
        anyhow::anyhow!("{} faults:\n{}", told.len(), told.join("\n"))
    })
}

fn parse_suite_id(id: &str) -> anyhow::Result<(String, u32)> {
    let Some((name, version)) = id.split_once('@') else { bail!("{id:?} is not a suite: expected name@version") };
    let version: u32 = version.parse().with_context(|| format!("{version:?} is not a version"))?;
    let is_name = !name.is_empty() && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-');
    if !is_name {
        bail!("{name:?} is not a suite name: lower-case letters, digits and dashes");
    }
    Ok((name.to_owned(), version))
}
