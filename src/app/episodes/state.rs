//! An episode as it is stored and as its owner sees it.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::actions::job::WorldState;
use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::hidden::instances::{instance, instance_to_act_on};
use crate::app::limits::LIMITS;
use crate::app::submissions::log_size::most_blocks;
use crate::clock::now_ms;
use crate::clock::steady::is_doubted;
use crate::store::episodes::{Attempt, EpisodeRow, pack, unpack};
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::Track;
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
    /// What the code of each turn told, for the submission.
    #[serde(default)]
    pub told: Vec<TurnReplay>,
    /// Track of the prompts.
    #[serde(default)]
    track: Track,
}

/// The last step, so that its request may be repeated and gets the same answer.
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
    pub fn first(track: Track) -> Self {
        let world = WorldState::default();
        let mut stored = Self { turn: 1, log: String::new(), world, last: None, told: Vec::new(), track };
        stored.set_log(&BlockLog { turns: vec![Vec::new()], profile: Profile::Mindcraft, ..BlockLog::default() });
        stored
    }

    /// Adds what the code of a step told to its turn.
    pub fn tell(&mut self, told: TurnReplay) {
        match self.told.last_mut().filter(|last| last.turn == told.turn) {
            Some(turn) => turn.append(told),
            None => self.told.push(told),
        }
    }

    /// Returns the log so far.
    ///
    /// # Errors
    /// Returns 500 if what is stored is no log.
    pub fn log(&self) -> AppResult<BlockLog> {
        BlockLog::from_canonical_json(self.log.as_bytes()).map_err(|error| AppError::damaged("episodes", error))
    }

    /// Replaces the log.
    pub fn set_log(&mut self, log: &BlockLog) {
        self.log = String::from_utf8(log.canonical_json()).expect("JSON is UTF-8");
    }

    /// Packs it for storage. It may take a while.
    ///
    /// # Errors
    /// Returns 422 if it takes more than an episode may, and 500 if it cannot be packed.
    pub fn packed(&self) -> AppResult<Vec<u8>> {
        let json = serde_json::to_vec(self).expect("a state is strings and numbers");
        if json.len() > LIMITS.episode_bytes {
            let mut faults = Faults::new();
            faults.add(format!("the episode would take more than {} bytes; submit it", LIMITS.episode_bytes));
            return Err(AppError::faulty(faults));
        }
        Ok(pack(&json)?)
    }

    /// Reads what was packed. It may take a while.
    fn unpacked(packed: &[u8]) -> AppResult<Self> {
        serde_json::from_slice(&unpack(packed)?).map_err(|error| AppError::damaged("episodes", error))
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
    /// Conventions that brief prompts take for granted; none with other prompts.
    pub preamble: Option<String>,
    /// Greatest number of blocks that may stand.
    pub most_blocks: usize,
}

impl Episode {
    /// Finds an episode of the caller.
    ///
    /// # Errors
    /// Returns 404 if there is no such episode, and 403 if it belongs to another owner.
    pub async fn of_caller(app: &App, caller: &Caller, id: &str) -> AppResult<Self> {
        Self::find(app, caller, id, Access::Look).await
    }

    /// Finds an episode that the caller may go on with: at a hidden instance only the entrant may.
    ///
    /// # Errors
    /// Returns the errors of [`of_caller`](Self::of_caller), and 403 to an operator in an entrant's place.
    pub async fn to_act_on(app: &App, caller: &Caller, id: &str) -> AppResult<Self> {
        Self::find(app, caller, id, Access::Act).await
    }

    async fn find(app: &App, caller: &Caller, id: &str, access: Access) -> AppResult<Self> {
        caller.require(Scope::Submit)?;
        let row = app.store.episode(id).await?;
        let mut row = row.ok_or_else(|| AppError::not_found(format!("there is no episode {id:?}")))?;
        caller.require_own(row.owner.as_deref(), "episode")?;
        let state = std::mem::take(&mut row.state);
        let reading = tokio::task::spawn_blocking(move || Stored::unpacked(&state));
        let stored = reading.await.map_err(|error| AppError::internal(&error))??;
        let Attempted { task, prompts, preamble, most_blocks } =
            attempted(app, caller, &row.attempt, stored.track, access).await?;
        Ok(Self { row, stored, task, prompts, preamble, most_blocks })
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

    /// Says that it has expired, and what to do.
    pub const fn why_expired(&self) -> &'static str {
        match self.task {
            Some(_) => "the episode has expired; open another one",
            None => "the episode has expired; open another one if its instance still takes an answer",
        }
    }

    /// Checks that it takes another step of this number.
    ///
    /// # Errors
    /// Returns 409 if it has ended or made all its steps, if it is being submitted, or if its next step has another
    /// number.
    pub fn must_take(&self, step: Option<i64>) -> AppResult<()> {
        let over = |why: &str| Err(AppError::conflict("episode-over", why));
        match self.state() {
            EpisodeState::Submitted => return over("the episode was submitted; open another one"),
            EpisodeState::Expired if is_doubted() => return Err(AppError::clock_in_doubt()),
            EpisodeState::Expired => return over(self.why_expired()),
            EpisodeState::Open if self.row.submitting_at_ms.is_some() => {
                return over("the episode is being submitted; if that was interrupted, submit it again");
            }
            EpisodeState::Open if self.row.step >= LIMITS.episode_steps => {
                return over(&format!("the episode has made {} steps; submit it", LIMITS.episode_steps));
            }
            EpisodeState::Open => {}
        }
        let next = self.row.step + 1;
        if step.is_some_and(|step| step != next) {
            return Err(AppError::conflict("other-step", format!("the next step of this episode is {next}")));
        }
        Ok(())
    }

    /// Returns the answer to the last step if this request repeats it.
    #[must_use]
    pub fn repeated(&self, step: Option<i64>, hash: &str) -> Option<&Value> {
        let last = self.stored.last.as_ref().filter(|last| last.hash == hash)?;
        (step == Some(self.row.step)).then_some(&last.answer)
    }
}

/// What an episode is an attempt at, as far as its owner may know.
struct Attempted {
    task: Option<String>,
    prompts: Vec<String>,
    preamble: Option<String>,
    most_blocks: usize,
}

/// What the caller wants with an episode.
#[derive(Debug, Clone, Copy)]
enum Access {
    /// To see it.
    Look,
    /// To change it.
    Act,
}

async fn attempted(
    app: &App,
    caller: &Caller,
    attempt: &Attempt,
    track: Track,
    access: Access,
) -> AppResult<Attempted> {
    match attempt {
        // The limit is the lower one for every instance, so that it tells nothing of the checks.
        Attempt::Instance(id) => {
            let prompts = match access {
                Access::Look => instance(app, caller, id).await?.prompts,
                Access::Act => instance_to_act_on(app, caller, id).await?.prompts,
            };
            Ok(Attempted { task: None, prompts, preamble: None, most_blocks: LIMITS.blocks_with_stress })
        }
        Attempt::Task { suite_id, number, .. } => {
            let entry = app.find_suite(suite_id).await?;
            let task = entry.as_ref().and_then(|entry| entry.task_numbered(*number));
            let missing = || AppError::internal(&format!("{suite_id} has no task {number}"));
            let (task, _) = task.ok_or_else(missing)?;
            let prompts =
                task.turns.iter().map(|turn| turn.prompt_on(track).unwrap_or(&turn.prompt).to_owned()).collect();
            let preamble = entry.as_ref().and_then(|entry| entry.suite.preamble.clone());
            let preamble = preamble.filter(|_| track == Track::Brief);
            Ok(Attempted { task: Some(task.id.clone()), prompts, preamble, most_blocks: most_blocks(task) })
        }
    }
}
