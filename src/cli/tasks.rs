//! `plumbline tasks`: shows the tasks of this program's suite, and validates and imports task files.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Subcommand;
use serde_json::Value;

use super::database::DatabaseArgs;
use super::files;
use super::process::block_on;
use super::validate::{self, ValidateArgs};
use crate::clock::now_ms;
use crate::store::location::Location;
use crate::store::suites::SuiteStored;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::saboteur_table;
use plumbline_engine::hidden::GENERATOR_VERSION;
use plumbline_engine::hidden::siblings::Siblings;
use plumbline_engine::tasks::family::{entailment_table, json_schema};
use plumbline_engine::tasks::published::{TaskFile, read_task_files};
use plumbline_engine::tasks::{Suite, Task, embedded, hidden};
use plumbline_engine::text::{agreeing, counted, did_you_mean};

/// Suite names that are reserved for this program.
const OWN_SUITES: [&str; 3] = [embedded::FULL, "mineceraft-lite", "hidden"];

/// Commands on tasks and task files.
#[derive(Debug, Subcommand)]
pub enum TasksCommand {
    /// List the tasks of the suite, one per line: number, id, number of turns, criteria.
    List {
        /// List only families whose name contains this text.
        #[arg(long)]
        family: Option<String>,
        /// List only tasks to which this criterion applies.
        #[arg(long)]
        criterion: Option<String>,
    },
    /// Show the prompts and checks of a task.
    Show {
        /// Id or number of the task.
        task: String,
        /// Print the task as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Validate the files of a suite, and check that every task is solved by its builder.
    Validate(ValidateArgs),
    /// Print the JSON Schema of family files.
    Schema,
    /// Print a table of the phrases that ask for each check, for the public and the hidden suite.
    Entailment,
    /// Print the public specifications from which official runs of hidden evaluation draw siblings, one JSON object per
    /// line.
    Siblings {
        /// Draw the list anew, and do not print the one that this program has.
        #[arg(long)]
        draw: bool,
    },
    /// Print a table of the criteria that each saboteur makes fail, by family.
    Saboteurs,
    /// Check task files in the published format (JSON) or a folder of family files (TOML), and add them to a database
    /// as a suite. A stored suite never changes; import changes as a new version.
    Import {
        /// Task files, or one folder with `suite.toml` and one file per family.
        #[arg(required = true, value_name = "FILE|FOLDER")]
        files: Vec<PathBuf>,
        /// Name and version for a suite made of task files, by default imported@1; a folder states its own in
        /// `suite.toml`.
        #[arg(long)]
        suite: Option<String>,
        /// Database to add the suite to; without it, the files are only checked. The service may keep running.
        #[arg(long, value_name = "FILE|URL")]
        database: Option<Location>,
    },
}

/// Runs the command.
///
/// # Errors
/// Returns an error if there is no such task or criterion, or a file cannot be read or has faults; all faults are
/// listed.
pub fn run(command: TasksCommand) -> anyhow::Result<ExitCode> {
    match command {
        TasksCommand::List { family, criterion } => list(family.as_deref(), criterion.as_deref()),
        TasksCommand::Show { task, json } => show(&task, json),
        TasksCommand::Validate(args) => validate::run(&args),
        TasksCommand::Schema => print(&format!("{}\n", serde_json::to_string_pretty(&json_schema())?)),
        TasksCommand::Entailment => print(&entailment()?),
        TasksCommand::Siblings { draw: false } => print(Siblings::of(GENERATOR_VERSION)?.lines()),
        TasksCommand::Siblings { draw: true } => print(Siblings::draw(GENERATOR_VERSION)?.lines()),
        TasksCommand::Saboteurs => print(&saboteur_table::markdown(&suite()?)),
        TasksCommand::Import { files, suite, database } => import(&files, suite.as_deref(), database),
    }
}

/// Returns the task of this program's suite with this id or number.
///
/// # Errors
/// Returns an error if there is no such task.
pub fn find(wanted: &str) -> anyhow::Result<Task> {
    let is_wanted = |task: &Task| task.id == wanted || Ok(task.number) == wanted.parse();
    let found = suite()?.tasks.into_iter().find(is_wanted);
    found.with_context(|| {
        let tasks = suite().map(|suite| suite.tasks).unwrap_or_default();
        let near = did_you_mean(wanted, tasks.iter().map(|task| task.id.as_str()));
        format!("there is no task {wanted:?}{near} (`plumbline tasks list` lists them)")
    })
}

/// Returns the latest version of this program's suite.
///
/// # Errors
/// Returns an error if its files have faults.
pub fn suite() -> anyhow::Result<Suite> {
    embedded::latest().map_err(|faults| anyhow::anyhow!("the suite of this program is faulty: {faults:?}"))
}

fn print(text: &str) -> anyhow::Result<ExitCode> {
    std::io::stdout().lock().write_all(text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

/// Returns the tables of the latest public and hidden families, with headings.
fn entailment() -> anyhow::Result<String> {
    let faulty = |faults| anyhow::anyhow!("the suite of this program is faulty: {faults:?}");
    let [.., public] = embedded::sources().map_err(faulty)?;
    let secret = hidden::source(hidden::LATEST).map_err(faulty)?;
    Ok(format!(
        "# What asks for each check\n\nWritten by `plumbline tasks entailment`. Phrases are templates, as in the family files.\n\n\
         ## Public families\n\n{}\n## Hidden families\n\n{}",
        entailment_table(&public),
        entailment_table(&secret)
    ))
}

fn list(family: Option<&str>, criterion: Option<&str>) -> anyhow::Result<ExitCode> {
    let names = Criterion::ALL.map(Criterion::name);
    if let Some(unknown) = criterion.filter(|criterion| !names.contains(criterion)) {
        bail!("{unknown:?} is not a criterion: {}", names.join(", "));
    }
    let is_wanted = |task: &&Task| {
        family.is_none_or(|family| task.family().contains(family))
            && criterion.is_none_or(|wanted| task.criteria().iter().any(|criterion| criterion.name() == wanted))
    };
    let mut lines = String::new();
    for task in suite()?.tasks.iter().filter(is_wanted) {
        let criteria: Vec<&str> = task.criteria().into_iter().map(Criterion::name).collect();
        // Writing to a string does not fail.
        let _ = writeln!(lines, "{:>3}  {:<48} {} {}", task.number, task.id, task.turns.len(), criteria.join(","));
    }
    print(&lines)
}

fn show(wanted: &str, as_json: bool) -> anyhow::Result<ExitCode> {
    let task = find(wanted)?;
    let mut text = String::new();
    if as_json {
        text = serde_json::to_string_pretty(&task)?;
        text.push('\n');
    } else {
        let _ = writeln!(text, "{} (number {})", task.id, task.number);
        for (turn, instruction) in (1..).zip(&task.turns) {
            let _ = writeln!(text, "\nturn {turn}: {}", instruction.prompt);
            let shown = instruction.informational.iter().map(|check| (check, " (shown, does not count)"));
            for (check, note) in instruction.checks.iter().map(|check| (check, "")).chain(shown) {
                let args = serde_json::to_value(check)?.get_mut("args").map(Value::take).unwrap_or_default();
                let _ = writeln!(text, "  {} {args}{note}", check.name());
            }
        }
    }
    print(&text)
}

fn import(files: &[PathBuf], suite: Option<&str>, database: Option<Location>) -> anyhow::Result<ExitCode> {
    let suites = match files {
        [folder] if folder.is_dir() => {
            if suite.is_some() {
                bail!("--suite: {} states its own name and version in suite.toml", folder.display());
            }
            validate::suites_of(&validate::read_folder(folder)?)?
        }
        files => {
            let (name, version) = parse_suite_id(suite.unwrap_or("imported@1"))?;
            vec![Suite { name, version, preamble: None, tasks: read_files(files)? }]
        }
    };
    for suite in &suites {
        must_be_a_name(&suite.name)?;
        if OWN_SUITES.contains(&suite.name.as_str()) {
            bail!("{:?} is a suite of this program; give yours another name", suite.name);
        }
        let what = if files.iter().any(|file| file.is_dir()) { suite.id() } else { counted(files.len(), "file") };
        println!(
            "{what}, {}, {} over {}",
            counted(suite.tasks.len(), "problem"),
            counted(suite.check_count(), "check row"),
            agreeing(suite.instruction_count(), "entry", "entries")
        );
        if files.iter().any(|file| file.is_dir()) {
            for note in validate::not_certified(suite) {
                println!("{note}");
            }
        }
    }
    let Some(database) = database else {
        for suite in &suites {
            println!("checked, not stored; --database FILE stores it as {}", suite.id());
        }
        return Ok(ExitCode::SUCCESS);
    };
    let database = DatabaseArgs { database, secrets: None };
    for suite in &suites {
        store(suite, &database)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn store(suite: &Suite, database: &DatabaseArgs) -> anyhow::Result<()> {
    block_on(async {
        let store = database.open().await?;
        let stored = store.put_suite(suite, now_ms()).await?;
        store.close().await;
        match stored {
            SuiteStored::Added => println!("stored as {}", suite.id()),
            SuiteStored::Unchanged => println!("{} is already stored with the same content", suite.id()),
            SuiteStored::Conflict => {
                bail!("{} exists with different content; a change is a new version", suite.id())
            }
        }
        Ok(())
    })
}

fn read_files(files: &[PathBuf]) -> anyhow::Result<Vec<Task>> {
    let mut texts = Vec::with_capacity(files.len());
    for file in files {
        let text = files::text(file)?;
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        texts.push((name, text));
    }
    let files: Vec<TaskFile<'_>> = texts.iter().map(|(name, text)| TaskFile { name, text }).collect();
    read_task_files(&files).map_err(|faults| {
        let told: Vec<String> = faults.iter().map(ToString::to_string).collect();
        anyhow::anyhow!("{}:\n{}", counted(told.len(), "fault"), told.join("\n"))
    })
}

fn parse_suite_id(id: &str) -> anyhow::Result<(String, u32)> {
    let Some((name, version)) = id.split_once('@') else { bail!("{id:?} is not a suite: expected name@version") };
    let version: u32 = version.parse().with_context(|| format!("{version:?} is not a version"))?;
    must_be_a_name(name)?;
    Ok((name.to_owned(), version))
}

fn must_be_a_name(name: &str) -> anyhow::Result<()> {
    let is_name = !name.is_empty() && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-');
    if !is_name {
        bail!("{name:?} is not a suite name: expected lower-case letters, digits and dashes");
    }
    Ok(())
}
