//! An episode as it is stored and as its owner sees it.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::actions::job::WorldState;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::hidden::instances::instance;
use crate::clock::now_ms;
use crate::store::episodes::{Attempt, EpisodeRow};
use crate::store::keys::Scope;
use plumbline_engine::voxel::{BlockLog, Profile};

/// What is stored of an episode beside its row.
#[derive(Debug, Serialize, Deserialize)]
pub struct Stored {
    /// Number of the turn, from 1.
    pub turn: usize,
    /// Canonical JSON of the log so far.
    log: String,
    /// The world as it stands.
    pub world: WorldState,
    /// The last step.
    pub last: Option<LastStep>,
}

/// The last step, so that a repeated request gets the same answer.
#[derive(Debug, Serialize, Deserialize)]
pub struct LastStep {
    /// SHA-256 of operation and body, in hex.
    pub hash: String,
    /// What was answered.
    pub answer: Value,
}

impl Stored {
    /// Returns the state before the first step.
    #[must_use]
    pub fn first() -> Self {
        let mut stored = Self { turn: 1, log: String::new(), world: WorldState::default(), last: None };
        stored.set_log(&BlockLog { turns: vec![Vec::new()], profile: Profile::Mindcraft, ..BlockLog::default() });
        stored
    }

    /// Returns the log so far.
    ///
    /// # Errors
    /// Returns 500 if what is stored is no log.
    pub fn log(&self) -> AppResult<BlockLog> {
        BlockLog::from_canonical_json(self.log.as_bytes()).map_err(|error| AppError::internal(&error))
    }

    /// Replaces the log.
    pub fn set_log(&mut self, log: &BlockLog) {
        self.log = String::from_utf8(log.canonical_json()).expect("JSON is UTF-8");
    }

    /// Returns it as JSON.
    #[must_use]
    pub fn json(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("a state is strings and numbers")
    }
}

/// State of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeState {
    /// It takes steps.
    Open,
    /// It was submitted.
    Submitted,
    /// Its time ran out before it was submitted.
    Expired,
}

/// An episode that its owner may act on.
#[derive(Debug)]
pub struct Episode {
    /// Its row.
    pub row: EpisodeRow,
    /// What is stored of it.
    pub stored: Stored,
    /// Identifier of its task; none for a hidden instance.
    pub task: Option<String>,
    /// Instruction of each turn.
    pub prompts: Vec<String>,
}

impl Episode {
    /// Finds an episode of the caller.
    ///
    /// # Errors
    /// Returns 404 if there is no such episode, and 403 if it belongs to another owner.
    pub async fn of_caller(app: &App, caller: &Caller, id: &str) -> AppResult<Self> {
        caller.require(Scope::Submit)?;
        let row = app.store.episode(id).await?;
        let row = row.ok_or_else(|| AppError::not_found(format!("there is no episode {id:?}")))?;
        caller.require_own(row.owner.as_deref(), "episode")?;
        let stored = serde_json::from_slice(&row.state).map_err(|error| AppError::internal(&error))?;
        let (task, prompts) = task_of(app, caller, &row.attempt).await?;
        Ok(Self { row, stored, task, prompts })
    }

    /// Returns its state.
    #[must_use]
    pub fn state(&self) -> EpisodeState {
        if self.row.submitted_at_ms.is_some() {
            EpisodeState::Submitted
        } else if self.row.expires_at_ms <= now_ms() {
            EpisodeState::Expired
        } else {
            EpisodeState::Open
        }
    }

    /// Checks that it takes another step of this number.
    ///
    /// # Errors
    /// Returns 409 if it has ended, or if its next step has another number.
    pub fn must_take(&self, step: Option<i64>) -> AppResult<()> {
        self.must_be_open()?;
        let next = self.row.step + 1;
        if step.is_some_and(|step| step != next) {
            return Err(AppError::conflict("other-step", format!("the next step of this episode is {next}")));
        }
        Ok(())
    }

    /// Checks that it has not ended.
    ///
    /// # Errors
    /// Returns 409 if it was submitted, or expired.
    pub fn must_be_open(&self) -> AppResult<()> {
        match self.state() {
            EpisodeState::Open => Ok(()),
            EpisodeState::Submitted => {
                Err(AppError::conflict("episode-over", "the episode was submitted; open another one"))
            }
            EpisodeState::Expired => {
                Err(AppError::conflict("episode-over", "the episode has expired; open another one"))
            }
        }
    }

    /// Returns the answer to the last step if this request repeats it.
    #[must_use]
    pub fn repeated(&self, step: Option<i64>, hash: &str) -> Option<&Value> {
        let last = self.stored.last.as_ref().filter(|last| last.hash == hash)?;
        (step == Some(self.row.step)).then_some(&last.answer)
    }
}

/// Returns the identifier of a task that is no secret, and the prompts.
async fn task_of(app: &App, caller: &Caller, attempt: &Attempt) -> AppResult<(Option<String>, Vec<String>)> {
    match attempt {
        Attempt::Instance(id) => Ok((None, instance(app, caller, id).await?.prompts)),
        Attempt::Task { suite_id, number, .. } => {
            let entry = app.find_suite(suite_id).await?;
            let task = entry.as_ref().and_then(|entry| entry.task_numbered(*number));
            let missing = || AppError::internal(&format!("{suite_id} has no task {number}"));
            let (task, _) = task.ok_or_else(missing)?;
            Ok((Some(task.id.clone()), task.turns.iter().map(|turn| turn.prompt.clone()).collect()))
        }
    }
}
