//! Opening an episode.

use uuid::Uuid;

use super::body::NewEpisode;
use super::state::{Episode, Stored};
use crate::app::App;
use crate::app::access::Caller;
use crate::app::catalogue::suites::no_suite;
use crate::app::error::{AppError, AppResult};
use crate::app::hidden::instances::unanswered;
use crate::app::limits::LIMITS;
use crate::clock::now_ms;
use crate::store::episodes::{Attempt, EpisodeRow};
use crate::store::keys::Scope;
use crate::store::states::RunState;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::Track;
use plumbline_engine::tasks::embedded::FULL;

/// Opens an episode, which is durable when this returns.
///
/// # Errors
/// Returns all faults of the body, 409 if the run is closed, or the instance was answered or has expired, and 429 if
/// the owner has too many open episodes.
pub async fn open(app: &App, caller: &Caller, draft: Option<NewEpisode>, mut faults: Faults) -> AppResult<Episode> {
    caller.require(Scope::Submit)?;
    let Some(new) = draft.filter(|_| faults.is_empty()) else { return Err(AppError::faulty(faults)) };
    let now = now_ms();
    let mut expires_at_ms = now + LIMITS.episode_seconds * 1_000;
    let (attempt, track) = match new.instance {
        Some(id) => {
            if new.suite.is_some() || new.run.is_some() {
                faults.add("an instance belongs to its entry; leave suite and run out");
                return Err(AppError::faulty(faults));
            }
            expires_at_ms = expires_at_ms.min(unanswered(app, caller, &id).await?.expires_at_ms);
            (Attempt::Instance(id), Track::Specified)
        }
        None => task_attempt(app, caller, new, &mut faults).await?.ok_or_else(|| AppError::faulty(faults))?,
    };
    let row = EpisodeRow {
        id: Uuid::now_v7().to_string(),
        owner: caller.owner().map(str::to_owned),
        attempt,
        created_at_ms: now,
        expires_at_ms,
        step: 0,
        state: Stored::first(track).packed()?,
        submitting_at_ms: None,
        submitted_at_ms: None,
        submission_id: None,
    };
    let most = LIMITS.episodes_per_owner;
    if !app.store.open_episode(&row, most).await? {
        let detail = format!("{most} episodes are open; submit some, or wait until they expire");
        return Err(AppError::too_many(&detail));
    }
    Episode::of_caller(app, caller, &row.id).await
}

/// Finds the task of a new episode and the track of its prompts, which is that of its run. Returns `None` if there are
/// faults.
async fn task_attempt(
    app: &App,
    caller: &Caller,
    new: NewEpisode,
    faults: &mut Faults,
) -> AppResult<Option<(Attempt, Track)>> {
    let Some(task) = new.task else { return Ok(None) };
    let (suite, track) = match &new.run {
        None => (new.suite.unwrap_or_else(|| FULL.to_owned()), Track::Specified),
        Some(run) => {
            if new.suite.is_some() {
                faults.add_at("suite", "a submission to a run takes the run's suite; leave it out");
            }
            let Some(row) = app.store.run(run).await? else {
                faults.add_at("run", format!("there is no run {run:?}"));
                return Ok(None);
            };
            caller.require_own(row.owner.as_deref(), "run")?;
            if row.state != RunState::Open {
                return Err(AppError::conflict("run-closed", "the run accepts no more submissions; open another one"));
            }
            (row.suite_id, row.track)
        }
    };
    let Some(entry) = app.find_suite(&suite).await? else {
        faults.add_at("suite", no_suite(&app.catalogue(), &suite));
        return Ok(None);
    };
    let number = task.number_in(&entry, faults).filter(|_| faults.is_empty());
    Ok(number.map(|number| (Attempt::Task { suite_id: entry.id.clone(), number, run_id: new.run }, track)))
}
