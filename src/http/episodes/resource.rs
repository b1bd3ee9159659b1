//! Opening, reading and submitting episodes.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;

use crate::app::access::Caller;
use crate::app::episodes::body::{NewEpisode, SubmitEpisode};
use crate::app::episodes::open::open;
use crate::app::episodes::state::{Episode, EpisodeState};
use crate::app::episodes::turns::{Submitted, submit};
use crate::app::error::AppResult;
use crate::app::limits::LIMITS;
use crate::clock::rfc3339;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::hidden::instances::AnswerTaken;
use crate::http::state::AppState;
use crate::store::episodes::Attempt;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// An episode.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EpisodeBody {
    /// Identifier of the episode.
    #[schema(format = Uuid)]
    pub id: String,
    /// State of the episode.
    pub state: EpisodeState,
    /// Identifier of the task; null for a hidden instance.
    #[schema(example = "walls/5x1x5-raise")]
    pub task: Option<String>,
    /// `name@version` of the task's suite; null for a hidden instance.
    pub suite: Option<String>,
    /// Run that the submission will belong to.
    #[schema(format = Uuid)]
    pub run: Option<String>,
    /// Hidden instance that is attempted.
    pub instance: Option<String>,
    /// Number of the turn, from 1.
    #[schema(minimum = 1)]
    pub turn: usize,
    /// Number of turns.
    #[schema(minimum = 1)]
    pub turns: usize,
    /// Instruction of the turn, on the track of the run.
    pub prompt: String,
    /// Conventions that prompts of the track `brief` take for granted; absent with other prompts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preamble: Option<String>,
    /// Number of the last step, from 1; 0 before the first.
    #[schema(minimum = 0)]
    pub step: i64,
    /// Number of steps that are left.
    #[schema(minimum = 0)]
    pub steps_left: i64,
    /// Position of the body: x, y and z.
    pub position: [f64; 3],
    /// Number of blocks that stand and were not there before the episode.
    #[schema(minimum = 0)]
    pub blocks: usize,
    /// The world, in words for an agent.
    pub world: WorldGuide,
    /// Time from which it takes no more steps (RFC 3339).
    #[schema(format = DateTime)]
    pub expires_at: String,
    /// Submission that it became; null before, and for a hidden instance.
    #[schema(format = Uuid)]
    pub submission: Option<String>,
}

/// What an agent must know of the world.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct WorldGuide {
    /// Directions of the axes.
    pub axes: &'static str,
    /// What is there before anything is built.
    pub ground: &'static str,
    /// Where the agent stands at the beginning.
    pub start: &'static str,
    /// Which blocks there are.
    pub blocks: &'static str,
    /// Rules of the world, a profile of `functions`.
    #[schema(example = "mindcraft")]
    pub profile: &'static str,
    /// Path of the list of functions that code may call.
    #[schema(example = "/v1/profiles")]
    pub functions: &'static str,
    /// Path of all limits.
    #[schema(example = "/v1/limits")]
    pub limits: &'static str,
}

/// The world of every episode.
const WORLD: WorldGuide = WorldGuide {
    axes: "x grows to the east, y upwards, z to the south; coordinates are integers",
    ground: "flat: grass_block at y = -1, dirt below it, air from y = 0 on",
    start: "you stand at (0, 0, 0) in creative mode, with enough of every block",
    blocks: "the blocks of Minecraft Java Edition 1.21.4 by their ids, such as oak_planks; /v1/blocks lists them",
    profile: "mindcraft",
    functions: "/v1/profiles",
    limits: "/v1/limits",
};

impl From<Episode> for EpisodeBody {
    fn from(episode: Episode) -> Self {
        let state = episode.state();
        let Episode { row, stored, task, mut prompts, preamble, .. } = episode;
        let turns = prompts.len();
        let (suite, run, instance) = match row.attempt {
            Attempt::Task { suite_id, run_id, .. } => (Some(suite_id), run_id, None),
            Attempt::Instance(id) => (None, None, Some(id)),
        };
        Self {
            id: row.id,
            state,
            task,
            suite,
            run,
            instance,
            turn: stored.turn,
            turns,
            preamble,
            prompt: prompts.swap_remove((stored.turn - 1).min(turns - 1)),
            step: row.step,
            steps_left: (LIMITS.episode_steps - row.step).max(0),
            position: stored.world.position,
            blocks: stored.world.standing().count(),
            world: WORLD,
            expires_at: rfc3339(row.expires_at_ms),
            submission: row.submission_id,
        }
    }
}

/// Opens an episode.
///
/// An episode is an attempt at a task or hidden instance, turn by turn, in a world that the service keeps. It is an
/// ordinary submission or answer once it is submitted. Episodes survive a restart of the service, and belong to the
/// owner of the key.
#[utoipa::path(
    post, path = "/v1/episodes", operation_id = "open_episode", tag = "episodes", summary = "Open an episode",
    request_body(content = NewEpisode, content_type = "application/json"),
    responses(
        (status = 201, description = "The episode, with the instruction of the first turn", body = EpisodeBody,
         headers(("Location" = String, description = "URL of the episode")),
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000004", "state": "open", "turn": 1, "turns": 1, "step": 0,
                           "prompt": "Build …" })),
        (status = 409, description = "The instance has its answer, or can no longer be answered"),
    )
)]
pub async fn open_episode(State(state): State<AppState>, caller: Caller, body: JsonBody) -> AppResult<Response> {
    let (draft, faults) = read_draft::<NewEpisode>(&body, "open one episode per request")?;
    let episode: EpisodeBody = open(&state, &caller, draft, faults).await?.into();
    let mut headers = HeaderMap::new();
    headers.extend(HeaderValue::from_str(&format!("/v1/episodes/{}", episode.id)).map(|url| (header::LOCATION, url)));
    Ok((StatusCode::CREATED, headers, Json(episode)).into_response())
}

/// Returns an episode.
///
/// An episode has its state, the instruction of the turn, and where the body stands.
#[utoipa::path(
    get, path = "/v1/episodes/{id}", operation_id = "get_episode", tag = "episodes", summary = "Get an episode",
    params(("id" = String, Path, description = "The episode's id")),
    responses(
        (status = 200, description = "The episode", body = EpisodeBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000004", "state": "open", "turn": 1, "turns": 1, "step": 2,
                           "prompt": "Build …" })),
        (status = 401, description = "No key"),
        (status = 403, description = "It is another owner's"),
    ),
    security(("key" = []))
)]
pub async fn get_episode(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<EpisodeBody>> {
    Ok(Json(Episode::of_caller(&state, &caller, &id).await?.into()))
}

/// What an episode became.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EpisodeSubmitted {
    /// The submission, which is graded as any other; null for a hidden instance.
    #[schema(format = Uuid)]
    pub submission: Option<String>,
    /// The answer to the hidden instance; null for a task.
    pub answer: Option<AnswerTaken>,
}

/// Submits an episode.
///
/// What was built is graded. Turns that were not begun are empty. Submitting again gives the same response. The body
/// is optional.
#[utoipa::path(
    post, path = "/v1/episodes/{id}/submit", operation_id = "submit_episode", tag = "episodes", summary = "Submit an episode",
    params(("id" = String, Path, description = "The episode's id")),
    request_body(content = Option<SubmitEpisode>, content_type = "application/json"),
    responses(
        (status = 202, description = "Stored durably; grading follows", body = EpisodeSubmitted,
         example = json!({ "submission": "0198c0de-0000-7000-8000-000000000001", "answer": null })),
        (status = 409, description = "It has expired, or the run has another log for the task or takes no more"),
    )
)]
pub async fn submit_episode(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: Option<JsonBody>,
) -> AppResult<Response> {
    caller.require(Scope::Submit)?;
    let draft = match &body {
        Some(body) if !body.is_null() => read_draft::<SubmitEpisode>(body, "submit one episode per request")?,
        _ => (Some(SubmitEpisode::default()), Faults::new()),
    };
    let submitted = match submit(&state, &caller, &id, draft).await? {
        Submitted::Submission(submission) => EpisodeSubmitted { submission: Some(submission), answer: None },
        Submitted::Answer(instance, answer) => {
            EpisodeSubmitted { submission: None, answer: Some(AnswerTaken::of(instance, *answer)) }
        }
    };
    Ok((StatusCode::ACCEPTED, Json(submitted)).into_response())
}
