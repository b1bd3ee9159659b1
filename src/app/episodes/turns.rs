//! Going on to the next turn of an episode, and submitting what was built.

use bytes::Bytes;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::body::NextTurn;
use super::state::{Episode, EpisodeState};
use super::step::{hash_of, keep_step};
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::hidden::instances::{AcceptedAnswer, answer_instance};
use crate::app::submissions::accept::accept;
use crate::app::submissions::posted::Format;
use crate::clock::now_ms;
use crate::store::episodes::Attempt;
use crate::store::idempotency::IdempotencyKey;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::hex;
use plumbline_engine::voxel::Profile;

/// Goes on to the next turn. It counts as a step.
///
/// # Errors
/// Returns all faults of the body, and 409 if the episode has ended, is in its last turn, or has another next step.
pub async fn next_turn(
    app: &App,
    caller: &Caller,
    id: &str,
    bytes: &[u8],
    (draft, faults): (Option<NextTurn>, Faults),
) -> AppResult<Episode> {
    let mut episode = Episode::of_caller(app, caller, id).await?;
    let Some(new) = draft.filter(|_| faults.is_empty()) else { return Err(AppError::faulty(faults)) };
    let hash = hash_of("next-turn", bytes);
    if episode.repeated(new.step, &hash).is_some() {
        return Ok(episode);
    }
    episode.must_take(new.step)?;
    let turns = episode.prompts.len();
    if episode.stored.turn >= turns {
        return Err(AppError::conflict("last-turn", format!("turn {turns} is the last; submit the episode")));
    }
    let mut log = episode.stored.log()?;
    log.turns.push(Vec::new());
    episode.stored.turn += 1;
    episode.stored.set_log(&log);
    keep_step(app, &mut episode, hash, &Value::Null).await?;
    Ok(episode)
}

/// What became of an episode.
#[derive(Debug)]
pub enum Submitted {
    /// Submission, by its identifier.
    Submission(String),
    /// Answer to a hidden instance, by its identifier.
    Answer(String, Box<AcceptedAnswer>),
}

/// Submits what was built: as a submission, or as the answer to the hidden instance. Turns that were not begun are
/// empty. Submitting again has no effect, and gives the same result.
///
/// # Errors
/// Returns the errors of submitting the same log, and 409 if the episode expired before.
pub async fn submit(app: &App, caller: &Caller, id: &str) -> AppResult<Submitted> {
    let episode = Episode::of_caller(app, caller, id).await?;
    if episode.state() == EpisodeState::Expired {
        episode.must_be_open()?;
    }
    if let Some(submission) = episode.row.submission_id {
        return Ok(Submitted::Submission(submission));
    }
    let mut log = episode.stored.log()?;
    log.turns.resize(episode.prompts.len(), Vec::new());
    let mut body = json!({ "turns": log.compact_turns(), "profile": Profile::Mindcraft });
    let submitted = match &episode.row.attempt {
        Attempt::Instance(instance) => {
            let answer = answer_instance(app, caller, instance, text(&body), Format::Json).await?;
            Submitted::Answer(instance.clone(), Box::new(answer))
        }
        Attempt::Task { suite_id, number, run_id } => {
            body["task"] = json!(number);
            match run_id {
                Some(run) => body["run"] = json!(run),
                None => body["suite"] = json!(suite_id),
            }
            let body = text(&body);
            // A request that is repeated after a crash finds the submission that the first one made.
            let once = IdempotencyKey {
                owner: caller.owner().unwrap_or_default().to_owned(),
                key: format!("episode {id}"),
                body_hash: hex(&Sha256::digest(&body)),
            };
            let accepted = accept(app, caller, body, Format::Json, Some(once)).await?.submissions;
            let one = accepted.into_iter().next();
            Submitted::Submission(
                one.ok_or_else(|| AppError::internal(&"one submission was posted, and none accepted"))?.id,
            )
        }
    };
    let submission = match &submitted {
        Submitted::Submission(id) => Some(id.as_str()),
        Submitted::Answer(..) => None,
    };
    app.store.end_episode(id, submission, now_ms()).await?;
    Ok(submitted)
}

fn text(body: &Value) -> Bytes {
    body.to_string().into()
}
