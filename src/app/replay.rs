//! Replay of action code: runs the code of agents and turns it into block events.

use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;

use crate::actions::job::{Answer, Job, TurnInput};
use crate::actions::pool::{Overloaded, TooLate};
use crate::actions::turn_replay::TurnReplay;
use crate::actions::{Profile, RecordedEvent, Replayed};
use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::event_budget::EventBudget;
use crate::app::limits::Limits;
use crate::app::structure_files::open_files;
use crate::app::submissions::posted::PostedSubmission;
use crate::fair::Permit;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::schema::EventAction;
use plumbline_engine::intake::text::thinking::thoughts_removed;
use plumbline_engine::voxel::{BlockLog, Cell, Event};

/// Takes a permit for a request whose action code runs or waits.
///
/// # Errors
/// Returns 429 if none is free.
pub fn take_permit(app: &App, who: &Arc<str>) -> AppResult<Permit> {
    app.action_requests
        .take(who)
        .map_err(|_| AppError::too_many("much action code is waiting to be run; send the request again in a moment"))
}

/// Runs a job for at most the time `left`, if it has a deadline, and takes from it what the job took.
async fn replayed(app: &App, who: &Arc<str>, job: &Job, left: &mut Option<Duration>) -> AppResult<Answer> {
    app.actions.run(job, who, left).await.map_err(|error| {
        if let Some(overloaded) = error.downcast_ref::<Overloaded>() {
            tracing::warn!(%overloaded, "the machine is overloaded");
            let detail = "the machine has too much to do to run this code; the request may be sent again";
            return AppError::new(Kind::Busy, detail).retry_after(5);
        }
        match error.downcast_ref::<TooLate>() {
            Some(_) => {
                let detail = format!(
                    "The deadline passed while the action code ran. Code that does not end is stopped after {} ms of \
                     processor time, and the answer says so; a longer deadline_ms leaves time for that.",
                    app.limits.action_cpu_ms
                );
                AppError::new(Kind::Deadline, detail).retry_after(1)
            }
            None => AppError::internal(&error),
        }
    })
}

/// Replays turns for a request that only replays code.
///
/// # Errors
/// Returns an error if too much code waits, if the code is too long or reaches a limit, or if it cannot be run.
pub async fn replay(app: &App, who: &Arc<str>, job: &Job) -> AppResult<Answer> {
    let mut faults = Faults::new();
    for (turn, number) in job.turns.iter().zip(0..) {
        if let TurnInput::Code(files) = turn {
            if job.turns.len() > 1 {
                faults.enter_key("turns");
                faults.enter_index(number);
            }
            add_too_long(files, app, &mut faults);
            if job.turns.len() > 1 {
                faults.leave();
                faults.leave();
            }
        }
    }
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    let _permit = take_permit(app, who)?;
    let answer = replayed(app, who, job, &mut None).await?;
    if let Some(stopped) = answer.stopped() {
        faults.add_at("action_code", stopped.to_string());
        return Err(AppError::faulty(faults));
    }
    Ok(answer)
}

/// Adds a fault for code that is too long. What a model only thought is not code, but counts towards the size of the text.
fn add_too_long(files: &[String], app: &App, faults: &mut Faults) -> bool {
    let limits = &app.limits;
    let bytes: usize = files.iter().map(String::len).sum();
    let (what, bytes, most) = if bytes > limits.action_text_bytes {
        ("bytes", bytes, limits.action_text_bytes)
    } else if bytes > limits.action_code_bytes {
        let code = files.iter().map(|file| thoughts_removed(file).len()).sum();
        ("bytes without thoughts", code, limits.action_code_bytes)
    } else {
        return false;
    };
    if bytes > most {
        faults.add_at("action_code", format!("{bytes} {what}; at most {most} are allowed"));
    }
    bytes > most
}

fn add_stopped(replayed: &Replayed, faults: &mut Faults) -> bool {
    if let Some(stopped) = &replayed.stopped {
        faults.add_at("action_code", stopped.to_string());
    }
    replayed.stopped.is_some()
}

/// Reads the structure files of submissions and runs their action code, and adds the events to their logs. A file that
/// cannot be read, and code that reaches a limit, is a fault.
///
/// # Errors
/// Returns 429 if too much code waits, and 500 if code cannot be run.
pub async fn complete_logs(
    app: &App,
    who: &Arc<str>,
    posted: &mut [PostedSubmission],
    faults: &mut Faults,
) -> AppResult<()> {
    let mut budget = EventBudget::whole(&app.limits);
    for submission in posted.iter_mut() {
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        open_files(app, who, &mut submission.sent, &mut budget, faults).await?;
        if !faults.is_empty() {
            break;
        }
    }
    if !faults.is_empty() || posted.iter().all(|submission| submission.sent.codes.is_empty()) {
        return Ok(());
    }
    let _permit = take_permit(app, who)?;
    for submission in posted {
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        let runs = Runs { left: &mut None, is_compared: true };
        submission.replays = complete(app, who, &mut submission.sent, &mut budget, faults, runs).await?;
        if !faults.is_empty() {
            break;
        }
    }
    Ok(())
}

/// Runs the code of a body that holds one log, if it has any.
///
/// # Errors
/// Returns an error if too much code waits, or if it cannot be run. Code that reaches a limit is a fault.
pub async fn complete_log(
    app: &App,
    who: &Arc<str>,
    sent: &mut SentLog,
    faults: &mut Faults,
) -> AppResult<Vec<TurnReplay>> {
    if sent.codes.is_empty() {
        return Ok(Vec::new());
    }
    let _permit = take_permit(app, who)?;
    let runs = Runs { left: &mut None, is_compared: true };
    complete(app, who, sent, &mut EventBudget::whole(&app.limits), faults, runs).await
}

/// Runs the code of one log under its profile for at most the time `left`, if it has a deadline, takes from it what the
/// code took, and adds the recorded events to the log. Stops at the first fault.
///
/// # Errors
/// Returns 504 if that time passes, and 500 if code cannot be run.
pub async fn complete_log_within(
    app: &App,
    who: &Arc<str>,
    sent: &mut SentLog,
    left: &mut Option<Duration>,
    faults: &mut Faults,
) -> AppResult<Vec<TurnReplay>> {
    let runs = Runs { left, is_compared: false };
    complete(app, who, sent, &mut EventBudget::whole(&app.limits), faults, runs).await
}

/// How code is run.
struct Runs<'a> {
    /// Time that the code may still take, if it has a deadline.
    left: &'a mut Option<Duration>,
    /// Whether to tell when another profile would have built otherwise.
    is_compared: bool,
}

async fn complete(
    app: &App,
    who: &Arc<str>,
    sent: &mut SentLog,
    budget: &mut EventBudget,
    faults: &mut Faults,
    Runs { left, is_compared }: Runs<'_>,
) -> AppResult<Vec<TurnReplay>> {
    let mut codes: Vec<(usize, Vec<String>)> =
        std::mem::take(&mut sent.codes).into_iter().map(|code| (code.turn, code.files)).collect();
    let mut replays = Vec::with_capacity(codes.len());
    faults.enter_key("turns");
    let mut is_too_long = false;
    for (turn, files) in &codes {
        faults.enter_index(*turn);
        is_too_long |= add_too_long(files, app, faults);
        faults.leave();
    }
    if is_too_long {
        codes.clear();
    }
    // Turns that share a world run together. Others run one after another: the recordings of all of them might not fit
    // into memory.
    let jobs: Vec<Vec<(usize, Vec<String>)>> = match sent.log.profile {
        Profile::Published => codes.into_iter().map(|code| vec![code]).collect(),
        Profile::Mindcraft if codes.is_empty() => Vec::new(),
        Profile::Mindcraft => vec![codes],
    };
    'jobs: for codes in jobs {
        let (job, turns) = job_of(&sent.log, codes);
        let job = Job { is_compared, ..job };
        let answer = replayed(app, who, &job, left).await?;
        let stopped = answer.stopped().map(ToString::to_string);
        for (turn, done) in turns.into_iter().zip(answer.turns).filter_map(|(turn, done)| Some((turn?, done))) {
            faults.enter_index(turn);
            let is_taken = take_events(&app.limits, &mut sent.log, ("action_code", turn), &done, budget, faults);
            faults.leave();
            if !is_taken {
                break 'jobs;
            }
            replays.push(TurnReplay::of(turn + 1, done));
        }
        // A process that ended without an answer does not tell in which turn.
        if let Some(stopped) = stopped {
            faults.add(stopped);
            break;
        }
    }
    faults.leave();
    Ok(replays)
}

/// Makes the job of a log's code. With it come the indices of the turns that hold code; none for a turn of events,
/// which is only there because later code sees what it built.
fn job_of(log: &BlockLog, codes: Vec<(usize, Vec<String>)>) -> (Job, Vec<Option<usize>>) {
    let profile = log.profile;
    if profile.is_published() {
        let (turns, inputs) = codes.into_iter().map(|(turn, files)| (Some(turn), TurnInput::Code(files))).unzip();
        return (Job { profile, turns: inputs, ..Job::default() }, turns);
    }
    let end = codes.last().map_or(0, |(turn, _)| turn + 1);
    let inputs = turn_inputs(log, codes, end);
    let turns = inputs.iter().zip(0..).map(|(input, turn)| matches!(input, TurnInput::Code(_)).then_some(turn));
    let turns = turns.collect();
    (Job { profile, turns: inputs, ..Job::default() }, turns)
}

/// Makes one job of all turns of a log, with or without code.
#[must_use]
pub fn job_of_all(mut sent: SentLog) -> Job {
    let codes = std::mem::take(&mut sent.codes).into_iter().map(|code| (code.turn, code.files)).collect();
    let turns = turn_inputs(&sent.log, codes, sent.log.turns.len());
    Job { profile: sent.log.profile, start: None, turns, is_compared: true }
}

/// Returns the first `end` turns of a log as a job holds them: the code of a turn, or its events.
fn turn_inputs(log: &BlockLog, codes: Vec<(usize, Vec<String>)>, end: usize) -> Vec<TurnInput> {
    let mut codes = codes.into_iter().peekable();
    let turns = (0..end).map(|turn| match codes.next_if(|(of, _)| *of == turn) {
        Some((_, files)) => TurnInput::Code(files),
        None => TurnInput::Events(events_of(log, turn)),
    });
    turns.collect()
}

/// Returns the events of a turn as a job holds them.
pub(in crate::app) fn events_of(log: &BlockLog, turn: usize) -> Vec<([i32; 3], Option<String>)> {
    let told = log.turns[turn].iter().map(|event| match *event {
        Event::Place { cell, material } => (cell.into(), Some(log.palette.name(material).to_owned())),
        Event::Remove { cell } => (cell.into(), None),
    });
    told.collect()
}

/// Adds events to their turn. Returns false if a limit was reached, which is a fault of the member that they came from.
pub(in crate::app) fn take_events(
    limits: &Limits,
    log: &mut BlockLog,
    (member, turn): (&'static str, usize),
    done: &Replayed,
    budget: &mut EventBudget,
    faults: &mut Faults,
) -> bool {
    if add_stopped(done, faults) {
        return false;
    }
    let events = done.events.len();
    if log.event_count() + events > limits.events {
        faults.add_at(member, format!("more than {} events in the log", limits.events));
        return false;
    }
    if !budget.take_events(events) {
        let most = limits.action_body_events;
        let detail = format!("the code of this body recorded more than {most} events; send it in parts");
        faults.add_at(member, detail);
        return false;
    }
    for event in &done.events {
        let [x, y, z] = event.cell;
        log.add_event(turn, Cell { x, y, z }, done.material(event));
    }
    if log.palette.len() > limits.materials {
        faults.add_at(member, format!("more than {} different materials in the log", limits.materials));
        return false;
    }
    true
}

/// Event that action code recorded.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReplayedEvent {
    /// `place` or `remove`.
    #[schema(example = "place")]
    pub action: EventAction,
    /// Coordinate to the east.
    pub x: i32,
    /// Coordinate upwards.
    pub y: i32,
    /// Coordinate to the south.
    pub z: i32,
    /// Material of the block, if one is placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// The block with its state in the game's own notation, if it has one that was named.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "oak_door[half=upper]")]
    pub block: Option<String>,
}

/// Returns the events of a script in the form in which they are served.
pub fn told(done: &Replayed) -> impl Iterator<Item = ReplayedEvent> {
    done.events.iter().map(|event: &RecordedEvent| {
        let [x, y, z] = event.cell;
        let material = done.material(event).map(str::to_owned);
        let action = if material.is_some() { EventAction::Place } else { EventAction::Remove };
        let block = done.block(event).filter(|block| Some(*block) != material.as_deref()).map(str::to_owned);
        ReplayedEvent { action, x, y, z, material, block }
    })
}

/// Block that stands after a replay.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StandingBlock {
    /// Coordinate to the east.
    pub x: i32,
    /// Coordinate upwards.
    pub y: i32,
    /// Coordinate to the south.
    pub z: i32,
    /// Name of the block, with the state that was named, in the game's own notation.
    #[schema(example = "oak_door[half=upper]")]
    pub block: String,
}

/// Returns the blocks that stand after a replay and were not there before, by y, x and z. `log` has the events of the turns
/// without code, unless the replay ends with a world.
#[must_use]
pub fn standing(mut log: BlockLog, answer: &Answer) -> Vec<StandingBlock> {
    if let Some(end) = &answer.end {
        let block = |([x, y, z], block): ([i32; 3], &str)| StandingBlock { x, y, z, block: block.to_owned() };
        return end.standing().map(block).collect();
    }
    let turns = log.turns.len().max(answer.turns.len());
    log.turns.resize(turns, Vec::new());
    for (turn, done) in answer.turns.iter().enumerate() {
        for event in &done.events {
            let [x, y, z] = event.cell;
            log.add_event(turn, Cell { x, y, z }, done.material(event));
        }
    }
    let Some(structure) = plumbline_engine::voxel::replay::Replay::new(&log).last() else { return Vec::new() };
    let mut blocks: Vec<StandingBlock> = (0..structure.len())
        .map(|i| (structure.cells()[i], structure.material(i).to_owned()))
        .map(|(Cell { x, y, z }, block)| StandingBlock { x, y, z, block })
        .collect();
    blocks.sort_by_key(|block| (block.y, block.x, block.z));
    blocks
}
