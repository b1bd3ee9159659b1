//! `plumbline replay`: runs action code and prints what it does, one event or block per line.

use std::io::Write as _;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use serde::Serialize;

use super::process::block_on;
use crate::actions::job::{Answer, Job, TurnInput};
use crate::actions::pool::Pool;
use crate::actions::{ACTION_LIMITS, CodeError, Profile, Replayed};
use crate::app::replay::{ReplayedEvent, standing, told};
use plumbline_engine::text::counted;
use plumbline_engine::voxel::BlockLog;

/// Writes a line to standard error; it does not matter whether anybody reads it.
macro_rules! say {
    ($($told:tt)*) => {
        drop(writeln!(std::io::stderr(), $($told)*))
    };
}

/// Exit code if code ended before its end.
const ENDED_EARLY: u8 = 3;

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// Rules of the replay: `published` records placing and breaking as the published pipeline does, each file for
    /// itself; `mindcraft` lets the code act in a game world that all files share.
    #[arg(long, value_name = "NAME", value_parser = profile)]
    profile: Option<Profile>,
    /// Print the blocks that stand at the end and were not there before, instead of the events.
    #[arg(long)]
    structure: bool,
    /// Files of a turn in their order, each an answer of a model as it came, or code; `-` reads standard input.
    /// `--turn` between files begins the next turn. Without `--profile` each file is run on its own.
    #[arg(required = true, value_name = "FILE", allow_hyphen_values = true, num_args = 1..)]
    files: Vec<String>,
}

fn profile(name: &str) -> Result<Profile, String> {
    Profile::named(name).ok_or_else(|| format!("there are {}", Profile::ALL.map(Profile::name).join(" and ")))
}

/// A file of a turn.
struct File {
    name: String,
    text: String,
}

/// Runs the command. Events or blocks go to standard output; dropped calls, notes and errors go to standard error.
///
/// The exit code is 0 if all code ran, 3 if some ended early, and 1 if none of it could be read. Without `--profile` it
/// is 1 if code was stopped at a limit or is not JavaScript, and 0 otherwise.
///
/// # Errors
/// Returns an error if a file cannot be read or is too large, or code cannot be run in a process.
pub fn run(args: &ReplayArgs) -> anyhow::Result<ExitCode> {
    let profile = args.profile.unwrap_or_default();
    let (turns, is_structure) = turns(args)?;
    let code = |files: &Vec<File>| TurnInput::Code(files.iter().map(|file| file.text.clone()).collect());
    let job = Job { profile, start: None, turns: turns.iter().map(code).collect(), is_compared: true };
    let run = async { Pool::new(1, ACTION_LIMITS).run(&job, &std::sync::Arc::from(""), &mut None).await };
    let answer = block_on(run)?;
    match print(&answer, is_structure) {
        // The reader has closed the pipe.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => return Ok(ExitCode::SUCCESS),
        printed => printed?,
    }
    for (files, done) in turns.iter().zip(&answer.turns) {
        explain(files, done);
    }
    Ok(exit_code(args.profile.is_some(), &answer))
}

fn exit_code(is_explicit: bool, answer: &Answer) -> ExitCode {
    let turns = &answer.turns;
    if !is_explicit {
        let is_whole = turns.iter().all(|done| done.stopped.is_none() && !done.unreadable);
        return if is_whole { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    }
    if turns.iter().all(|done| done.unreadable) {
        ExitCode::FAILURE
    } else if turns.iter().any(Replayed::ended_early) {
        ExitCode::from(ENDED_EARLY)
    } else {
        ExitCode::SUCCESS
    }
}

/// Reads the files of each turn, and whether `--structure` stood among them.
fn turns(args: &ReplayArgs) -> anyhow::Result<(Vec<Vec<File>>, bool)> {
    let mut turns: Vec<Vec<File>> = vec![Vec::new()];
    let mut is_structure = args.structure;
    for name in &args.files {
        match name.as_str() {
            "--turn" => turns.push(Vec::new()),
            "--structure" => is_structure = true,
            option if option.starts_with("--") => {
                anyhow::bail!("unexpected argument '{option}'; among the files there may be --turn and --structure")
            }
            name => turns.last_mut().expect("there is a first turn").push(read(name)?),
        }
    }
    if args.profile.is_none() {
        // Without a profile each file is on its own.
        turns = turns.into_iter().flatten().map(|file| vec![file]).collect();
    }
    turns.retain(|files| !files.is_empty());
    anyhow::ensure!(!turns.is_empty(), "no file was given");
    Ok((turns, is_structure))
}

fn read(name: &str) -> anyhow::Result<File> {
    let bytes = if name == "-" {
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut std::io::stdin().lock(), &mut bytes).map(|_| bytes)
    } else {
        std::fs::read(name)
    };
    let bytes = bytes.with_context(|| name.to_owned())?;
    let most = ACTION_LIMITS.code_bytes;
    anyhow::ensure!(bytes.len() <= most, "{name}: more than {most} bytes");
    let text = String::from_utf8(bytes).unwrap_or_else(|error| {
        say!("{name}: not UTF-8 at byte {}; wrong bytes were replaced", error.utf8_error().valid_up_to());
        String::from_utf8_lossy(error.as_bytes()).into_owned()
    });
    let text = text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text);
    Ok(File { name: name.to_owned(), text })
}

fn print(answer: &Answer, is_structure: bool) -> std::io::Result<()> {
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    if is_structure {
        for block in standing(BlockLog::default(), answer) {
            line(&mut out, &block)?;
        }
    } else {
        // States belong to what stands, so a line has the same members under each profile.
        for event in answer.turns.iter().flat_map(told) {
            line(&mut out, &ReplayedEvent { block: None, ..event })?;
        }
    }
    out.flush()
}

fn line(out: &mut impl std::io::Write, value: &impl Serialize) -> std::io::Result<()> {
    writeln!(out, "{}", serde_json::to_string(value)?)
}

/// Tells on standard error what happened to the files of a turn.
fn explain(files: &[File], done: &Replayed) {
    let name = files.iter().map(|file| file.name.as_str()).collect::<Vec<_>>().join(", ");
    for line in &done.log {
        say!("{name}: printed: {}", escaped(line));
    }
    for dropped in &done.dropped {
        say!("{name}: {} dropped: {}", counted(dropped.count as usize, "call"), escaped(&dropped.reason));
    }
    for note in &done.notes {
        say!("{name}: {}", escaped(note));
    }
    let built = counted(done.events.len(), "event");
    for CodeError { message, line, column, file, events, .. } in done.error.iter().chain(&done.more_errors) {
        let name = file.and_then(|number| files.get(number - 1)).map_or(name.as_str(), |file| file.name.as_str());
        let line = line.map(|line| format!(" line {line}:")).unwrap_or_default();
        let column = column.map(|column| format!(" (column {column})")).unwrap_or_default();
        let built = events.map_or_else(|| built.clone(), |events| counted(events, "event"));
        say!("{name}:{line} {}{column}; {built} in this turn", escaped(message));
    }
    if let Some(stopped) = &done.stopped {
        say!("{name}: stopped: {}", stopped.detail);
    }
}

/// Writes control characters as escapes, so that what code says cannot pretend to be a message or control a terminal.
fn escaped(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() }).collect()
}
