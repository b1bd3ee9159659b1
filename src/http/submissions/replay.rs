//! Replay of action code (`/v1/replay`): runs a script and returns the events that it records.

use axum::Json;
use axum::extract::State;
use serde::Serialize;

use crate::actions::turn_replay::TurnReplay;
use crate::actions::{CodeError, Dropped, Profile, Replayed};
use crate::app::access::Caller;
use crate::app::body::{profile, request_body};
use crate::app::error::{AppError, AppResult};
use crate::app::event_budget::EventBudget;
use crate::app::limits::LIMITS;
use crate::app::replay::{ReplayedEvent, StandingBlock, job_of_all, replay, standing, told};
use crate::app::structure_files::open_files;
use crate::app::submissions::log_member::turns;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::schema::{ActionCode, NewTurn};
use plumbline_engine::intake::tolerant::Texts;
use plumbline_engine::intake::{Faults, MAX_FILES};
use plumbline_engine::voxel::BlockLog;

/// Approximate size of an event in the response, in bytes, without the material's name.
const EVENT_BYTES: usize = 60;
/// Maximum size of a response, in bytes.
const ANSWER_BYTES: usize = LIMITS.replay_bytes;

request_body! {
    /// Action code to run: of one turn as `action_code`, or of several as `turns`.
    #[schema(example = json!({
        "profile": "mindcraft", "action_code": "await skills.placeBlock(bot, 'stone', 0, 0, 0);"
    }))]
    pub struct NewReplay: "an object with \"action_code\" or \"turns\" and, if wanted, \"profile\"" {
        /// Rules of the replay; `published` if absent.
        profile: Profile = optional(profile),
        /// Answer of a model as it came, or code as agents of the mindcraft framework write it; a list if the turn has
        /// several files, which run in order.
        #[schema(value_type = Option<ActionCode>)]
        action_code: Vec<String> = work(files),
        /// Turns, as a submission has them.
        #[schema(value_type = Option<Vec<NewTurn>>)]
        turns: SentLog = work(turns),
    }
    unknown: |_| "unknown field; a replay has profile, and action_code or turns"
}

fn files(faults: &mut Faults) -> Texts<'_> {
    Texts { faults, most: MAX_FILES }
}

/// Result of running action code.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReplayBody {
    /// Rules of the replay.
    pub profile: Profile,
    /// Blocks that the code placed and removed, in order, over all turns.
    pub events: Vec<ReplayedEvent>,
    /// Blocks that stand at the end and were not there before, by y, x and z.
    pub structure: Vec<StandingBlock>,
    /// Calls of the first turn with code that recorded nothing, by reason.
    pub dropped: Vec<Dropped>,
    /// Error that ended the first code, or a rejection that nothing handled; events recorded before it count.
    pub error: Option<CodeError>,
    /// Notes for the author of the first code although nothing failed, for example that a function was defined but
    /// never called.
    pub notes: Vec<String>,
    /// The turns that hold code, with everything that is told of them.
    pub turns: Vec<TurnReplay>,
}

/// Runs action code.
///
/// The response has the blocks that it places and removes, and those that stand at the end. Nothing is graded or
/// stored. Code that reaches a limit is refused, and the fault names the limit.
#[utoipa::path(
    post, path = "/v1/replay", operation_id = "replay_action_code", tag = "submissions", summary = "Run action code",
    request_body(content = NewReplay, content_type = "application/json"),
    responses(
        (status = 200, description = "The recorded events", body = ReplayBody,
         example = json!({ "profile": "published",
                           "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }],
                           "structure": [{ "x": 0, "y": 0, "z": 0, "block": "stone" }], "dropped": [], "error": null,
                           "notes": [], "turns": [{ "turn": 1, "events": 1 }] })),
    )
)]
pub async fn replay_action_code(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> AppResult<Json<ReplayBody>> {
    if caller.require(Scope::Grade).is_err() {
        caller.require(Scope::Submit)?;
    }
    let (new, mut faults) = read_draft::<NewReplay>(&body, "send one document per request")?;
    let Some(NewReplay { profile, action_code, turns }) = new.filter(|_| faults.is_empty()) else {
        return Err(AppError::faulty(faults));
    };
    let profile = profile.unwrap_or_default();
    let mut sent = turns.unwrap_or_else(|| SentLog::of_code_files(action_code.unwrap_or_default()));
    sent.log.profile = profile;
    open_files(&state, caller.who(), &mut sent, &mut EventBudget::whole(&state.limits), &mut faults).await?;
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    let with_code: Vec<usize> = sent.codes.iter().map(|code| code.turn + 1).collect();
    // Code under `published` runs without a world, so what the other turns leave is not in its answer.
    let log = if profile.is_published() { sent.log.clone() } else { BlockLog::default() };
    let answer = replay(&state, caller.who(), &job_of_all(sent)).await?;
    let structure = standing(log, &answer);
    // Every event repeats its material's name, so the response may be much larger than the recording.
    let event_bytes = |done: &Replayed| -> usize {
        done.events.iter().map(|event| EVENT_BYTES + 2 * done.block(event).map_or(0, str::len)).sum()
    };
    let bytes = answer.turns.iter().map(event_bytes).sum::<usize>()
        + structure.iter().map(|block| EVENT_BYTES + block.block.len()).sum::<usize>();
    if bytes > ANSWER_BYTES {
        faults.add_at("action_code", format!("its events take more than {ANSWER_BYTES} bytes in the response"));
        return Err(AppError::faulty(faults));
    }
    let events = answer.turns.iter().flat_map(told).collect();
    let mut turns: Vec<TurnReplay> =
        answer.turns.into_iter().zip(1..).map(|(done, turn)| TurnReplay::of(turn, done)).collect();
    turns.retain(|turn| with_code.contains(&turn.turn));
    let first = turns.first_mut();
    let (dropped, error, notes) =
        first.map(|turn| (turn.dropped.clone(), turn.error.clone(), turn.notes.clone())).unwrap_or_default();
    Ok(Json(ReplayBody { profile, events, structure, dropped, error, notes, turns }))
}
