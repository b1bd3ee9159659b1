//! Replay of action code: runs the code of agents and turns it into block events.

use std::sync::Arc;

use serde::Serialize;

use crate::actions::Replayed;
use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::app::submissions::posted::PostedSubmission;
use crate::fair::Permit;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::{SentLog, without_fences};
use plumbline_engine::intake::schema::EventAction;
use plumbline_engine::voxel::{BlockLog, Cell};

/// Takes a slot for a request whose action code runs or waits.
///
/// # Errors
/// Returns 429 if no slot is free.
pub fn place(app: &App, who: &Arc<str>) -> AppResult<Permit> {
    app.action_requests
        .take(who)
        .map_err(|_| AppError::too_many("much action code is waiting to be run; come back in a moment"))
}

async fn replayed(app: &App, who: &Arc<str>, code: &str) -> AppResult<Replayed> {
    app.actions.run(code, who).await.map_err(|error| AppError::internal(&error))
}

/// Runs a script for a request that only replays code.
///
/// # Errors
/// Returns an error if too much code waits, if the script is too long or reaches a limit, or if it cannot be run.
pub async fn replay(app: &App, who: &Arc<str>, code: &str) -> AppResult<Replayed> {
    let mut faults = Faults::new();
    if add_too_long(code, app, &mut faults) {
        return Err(AppError::faulty(faults));
    }
    let _permit = place(app, who)?;
    let done = replayed(app, who, &without_fences(code)).await?;
    if add_stopped(&done, &mut faults) {
        return Err(AppError::faulty(faults));
    }
    Ok(done)
}

fn add_too_long(code: &str, app: &App, faults: &mut Faults) -> bool {
    let most = app.limits.action_code_bytes;
    let is_too_long = code.len() > most;
    if is_too_long {
        faults.add_at("action_code", format!("{} bytes; at most {most} are allowed", code.len()));
    }
    is_too_long
}

fn add_stopped(replayed: &Replayed, faults: &mut Faults) -> bool {
    if let Some(stopped) = &replayed.stopped {
        faults.add_at("action_code", stopped.to_string());
    }
    replayed.stopped.is_some()
}

/// Number of events that the code of one body may still record.
#[derive(Debug)]
pub struct EventBudget {
    left: usize,
}

impl EventBudget {
    /// Creates the full budget.
    #[must_use]
    pub fn whole(app: &App) -> Self {
        Self { left: app.limits.action_body_events }
    }
}

/// Runs the action code of submissions, and adds the recorded events to their logs. Code that reaches a limit is a
/// fault.
///
/// # Errors
/// Returns 429 if too much code waits, and 500 if code cannot be run.
pub async fn run_codes(
    app: &App,
    who: &Arc<str>,
    posted: &mut [PostedSubmission],
    faults: &mut Faults,
) -> AppResult<()> {
    if posted.iter().all(|submission| submission.sent.codes.is_empty()) {
        return Ok(());
    }
    let _permit = place(app, who)?;
    let mut budget = EventBudget::whole(app);
    for submission in posted {
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        submission.replays = run_sent(app, who, &mut submission.sent, &mut budget, faults).await?;
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
pub async fn run_code(
    app: &App,
    who: &Arc<str>,
    sent: &mut SentLog,
    faults: &mut Faults,
) -> AppResult<Vec<TurnReplay>> {
    if sent.codes.is_empty() {
        return Ok(Vec::new());
    }
    let _permit = place(app, who)?;
    run_sent(app, who, sent, &mut EventBudget::whole(app), faults).await
}

/// Runs the code of one log, and adds the recorded events to it. Stops at the first fault.
///
/// # Errors
/// Returns 500 if code cannot be run.
pub async fn run_sent(
    app: &App,
    who: &Arc<str>,
    sent: &mut SentLog,
    budget: &mut EventBudget,
    faults: &mut Faults,
) -> AppResult<Vec<TurnReplay>> {
    let codes = std::mem::take(&mut sent.codes);
    let mut replays = Vec::with_capacity(codes.len());
    faults.enter_key("turns");
    let mut is_too_long = false;
    for code in &codes {
        faults.enter_index(code.turn);
        is_too_long |= add_too_long(&code.code, app, faults);
        faults.leave();
    }
    if !is_too_long {
        // Run them one after another: the recordings of all of them together might not fit into memory.
        for code in &codes {
            let done = replayed(app, who, &code.code).await?;
            faults.enter_index(code.turn);
            let is_taken = take_events(app, &mut sent.log, code.turn, &done, budget, faults);
            faults.leave();
            if !is_taken {
                break;
            }
            let Replayed { events, dropped, error, notes, unreadable, .. } = done;
            let (turn, events) = (code.turn + 1, events.len());
            replays.push(TurnReplay { turn, events, dropped, error, notes, unreadable });
        }
    }
    faults.leave();
    Ok(replays)
}

/// Adds the events of a script to its turn. Returns false if it reached a limit, which is a fault.
fn take_events(
    app: &App,
    log: &mut BlockLog,
    turn: usize,
    done: &Replayed,
    budget: &mut EventBudget,
    faults: &mut Faults,
) -> bool {
    if add_stopped(done, faults) {
        return false;
    }
    let (events, limits) = (done.events.len(), &app.limits);
    if log.event_count() + events > limits.events {
        faults.add_at("action_code", format!("more than {} events in the log", limits.events));
        return false;
    }
    if events > budget.left {
        let most = limits.action_body_events;
        let detail = format!("the code of this body recorded more than {most} events; send it in parts");
        faults.add_at("action_code", detail);
        return false;
    }
    budget.left -= events;
    for event in &done.events {
        let [x, y, z] = event.cell;
        let material = event.material.and_then(|index| done.palette.get(index as usize));
        log.add_event(turn, Cell { x, y, z }, material.map(String::as_str));
    }
    if log.palette.len() > limits.materials {
        faults.add_at("action_code", format!("more than {} different materials in the log", limits.materials));
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
}

/// Returns the events of a script in the form in which they are served.
pub fn told(done: &Replayed) -> impl Iterator<Item = ReplayedEvent> {
    done.events.iter().map(|event| {
        let [x, y, z] = event.cell;
        let material = event.material.and_then(|index| done.palette.get(index as usize)).cloned();
        let action = if material.is_some() { EventAction::Place } else { EventAction::Remove };
        ReplayedEvent { action, x, y, z, material }
    })
}
