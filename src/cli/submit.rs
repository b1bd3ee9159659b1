//! `plumbline submit`: posts raw records of the published pipeline to a service as one run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::json;

use super::process::block_on;
use super::{files, grade, progress};
use crate::app::body::agent_name;
use crate::client::{Answer, Service};
use plumbline_engine::grading::raw_records::RecordedProblem;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::read_document;
use plumbline_engine::text::counted;
use plumbline_engine::voxel::replay::events_between;
use plumbline_engine::voxel::{BlockLog, Structure};

/// What reads records whose numbers are not those of the suite.
const NUMBERED_ANEW: &str = "`plumbline-client mindcraft` (Python package) finds tasks by their prompts, where the pipeline left its action files";

/// Arguments of `submit`.
#[derive(Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub struct SubmitArgs {
    /// File of raw records, one JSON object per line.
    file: PathBuf,
    /// Name of the agent that built, as shown on the board.
    #[arg(long, required_unless_present = "run")]
    agent: Option<String>,
    /// Continue this run after an interrupted attempt; answers that it already has are not stored again. It must be of the
    /// suite, and of the agent if one is named.
    #[arg(long, value_name = "ID")]
    run: Option<String>,
    /// Skip problems that are not in the suite, such as those outside a Lite draw.
    #[arg(long)]
    only_suite: bool,
    /// Do not compare the prompts of the records with those of the suite; records go by their number alone.
    #[arg(long)]
    any_prompt: bool,
    /// Declare that tasks without a record are skipped on purpose: they count as failed, and the run is still compared
    /// with others on the board.
    #[arg(long, conflicts_with = "keep_open")]
    skip_rest: bool,
    /// Leave the run open for more answers; otherwise it is finished, and tasks without a record count as failed.
    #[arg(long)]
    keep_open: bool,
    /// Print what would be posted and where, without posting.
    #[arg(long)]
    dry_run: bool,
    /// Suite, as name or name@version. Its checks count, not those in the records; version 1 has the published checks.
    #[arg(long, default_value = "mineceraft@1")]
    suite: String,
    /// API key for writing, if the service requires one.
    #[arg(long, env = "PLUMBLINE_KEY", hide_env_values = true)]
    key: Option<String>,
    /// Address of the service.
    #[arg(long, env = "PLUMBLINE_SERVER", default_value = "http://localhost:7586")]
    server: String,
}

/// Runs the command.
///
/// # Errors
/// Returns an error if the file cannot be read or has faults, or the service cannot be reached or rejects a request.
pub fn run(args: &SubmitArgs) -> anyhow::Result<ExitCode> {
    eprintln!("server {}{}", args.server, if args.key.is_some() { ", with a key" } else { "" });
    let text = files::text(&args.file)?;
    let problems = grade::read_problems(&text).with_context(|| format!("{} is faulty", args.file.display()))?;
    let mut answers: Vec<Answer> = problems.iter().map(answer).collect();
    block_on(async {
        let service = Service::at(&args.server, args.key.as_deref())?;
        let agent = args.agent.as_deref().unwrap_or_default();
        // A name without a version is the newest, but the run is of the version that it was begun with.
        let (suite, answered) = match &args.run {
            None => (args.suite.clone(), BTreeSet::new()),
            Some(run) => (continues(&service, run, args).await?, service.answered(run).await?),
        };
        if args.run.is_none() {
            must_be_name(agent)?;
        }
        let tasks = service.prompts(&suite).await?;
        let given = answers.len();
        answers.retain(|answer| tasks.contains_key(&answer.number));
        if answers.len() < given && !args.only_suite {
            let others = given - answers.len();
            bail!("{others} of {given} problems are not in {suite}; --only-suite leaves them out; {NUMBERED_ANEW}");
        }
        if answers.is_empty() {
            bail!("{} holds no problem of {suite}", args.file.display());
        }
        if !args.any_prompt {
            must_ask_the_same(&problems, &tasks, &suite)?;
        }
        let is_there = |task: &u32| answered.contains(task) || answers.iter().any(|answer| answer.number == *task);
        let missing = tasks.keys().filter(|task| !is_there(task)).count();
        if missing > 0 && !args.keep_open {
            let then = if args.skip_rest {
                "are skipped on purpose and count as failed"
            } else {
                "count as failed, and the run is not compared with others (--skip-rest declares that they are skipped on purpose)"
            };
            eprintln!("{missing} of {} tasks have no record: they {then}", tasks.len());
        }
        if args.dry_run {
            let run = args.run.as_ref().map_or_else(|| format!("a new run of {agent:?}"), |run| format!("run {run}"));
            let answers = counted(answers.len(), "answer");
            println!("would post {answers} to {run} in {suite}; nothing was posted");
            return Ok(ExitCode::SUCCESS);
        }
        let run = match &args.run {
            Some(run) => run.clone(),
            None => service.create_run(agent, &suite, json!({ "source": "raw records" })).await?,
        };
        eprintln!("run {run}");
        let go_on = || format!("the run stays as it is: once the cause is fixed, go on with --run {run}");
        let bar = progress::bar(answers.len(), "posting");
        service.post_answers(&run, &answers, |posted| bar.inc(posted as u64)).await.with_context(go_on)?;
        bar.finish_and_clear();
        let bar = progress::bar(answers.len(), "grading");
        if args.keep_open {
            println!("{}", serde_json::to_string_pretty(&service.get(&format!("/v1/runs/{run}")).await?)?);
            return Ok(ExitCode::SUCCESS);
        }
        let finished =
            service.finish_run(&run, args.skip_rest, |graded| bar.set_position(graded)).await.with_context(go_on)?;
        bar.finish_and_clear();
        println!("{}", serde_json::to_string_pretty(&finished)?);
        Ok(ExitCode::SUCCESS)
    })
}

/// Checks that a run can be continued with these answers, and returns its suite with the version.
async fn continues(service: &Service, run: &str, args: &SubmitArgs) -> anyhow::Result<String> {
    let found = service.get(&format!("/v1/runs/{run}")).await.with_context(|| format!("--run {run}"))?;
    let suite = found["suite"].as_str().unwrap_or_default();
    // An anonymous run has another name for others than for its owner.
    let agent = found["embargo"]["agent"].as_str().or(found["agent"].as_str()).unwrap_or_default();
    if suite != args.suite && suite.split('@').next() != Some(&args.suite) {
        bail!("--run {run} is a run of {suite}, and the answers are of {}: give --suite {suite}", args.suite);
    }
    if let Some(named) = args.agent.as_deref().filter(|named| *named != agent) {
        bail!("--run {run} is of the agent {agent:?}, and --agent names {named:?}: leave one of them out");
    }
    Ok(suite.to_owned())
}

/// Checks the name of an agent as the service does, so that a dry run refuses what it would refuse.
fn must_be_name(agent: &str) -> anyhow::Result<()> {
    let mut faults = Faults::new();
    read_document(&serde_json::to_vec(agent)?, agent_name(&mut faults))?;
    match faults.into_list().first() {
        Some(fault) => bail!("--agent: {}", fault.detail),
        None => Ok(()),
    }
}

/// Checks that the first records of problems were made for the prompts of the suite, as far as they give theirs: the
/// published pipeline numbers the problems of a file anew.
fn must_ask_the_same(problems: &[RecordedProblem], tasks: &BTreeMap<u32, String>, suite: &str) -> anyhow::Result<()> {
    /// Number of problems that are named.
    const MAX_NAMED: usize = 5;
    let is_same = |one: &str, other: &str| one.split_whitespace().eq(other.split_whitespace());
    let differs = |problem: &&RecordedProblem| {
        let asked = problem.task.turns.first().map(|turn| turn.prompt.trim()).filter(|prompt| !prompt.is_empty());
        let wanted = tasks.get(&problem.task.number);
        asked.zip(wanted).is_some_and(|(asked, wanted)| !is_same(asked, wanted))
    };
    let has_none = |problem: &&RecordedProblem| problem.task.turns.iter().all(|turn| turn.prompt.trim().is_empty());
    let without = problems.iter().filter(has_none).count();
    if without > 0 {
        eprintln!("{without} of {} problems have no prompt: they go by number alone", problems.len());
    }
    let others: Vec<u32> = problems.iter().filter(differs).map(|problem| problem.task.number).collect();
    let Some(first) = others.first() else { return Ok(()) };
    let named: Vec<String> = others.iter().take(MAX_NAMED).map(u32::to_string).collect();
    let more = if others.len() > MAX_NAMED { ", …" } else { "" };
    let prompt = &tasks[first];
    bail!(
        "{} of {} problems were asked otherwise than in {suite} (run_idx {}{more}); there, task {first} is {prompt:?}: \
         --suite names the suite whose prompts were given, --any-prompt goes by number alone, and {NUMBERED_ANEW}",
        others.len(),
        problems.len(),
        named.join(", ")
    );
}

/// Converts recorded structures into the events that lead to them. Several entries for one cell become one, since a log
/// cannot list a cell twice.
fn answer(problem: &RecordedProblem) -> Answer {
    let mut log = BlockLog::default();
    let mut before = Structure::from_named([]);
    for structure in &problem.structures {
        let turn = events_between(&before, structure, |name| log.palette.intern(name));
        log.turns.push(turn);
        before = structure.clone();
    }
    Answer { number: problem.task.number, log }
}
