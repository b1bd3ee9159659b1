//! Going on to the next turn of an episode, and submitting what was built.

use bytes::Bytes;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::body::{NextTurn, SubmitEpisode};
use super::state::{Episode, EpisodeState, LastStep};
use super::step::{hash_of, keep_step};
use crate::app::App;
use crate::app::access::Caller;
use crate::app::blocking::blocking;
use crate::app::error::{AppError, AppResult};
use crate::app::hidden::instances::{AcceptedAnswer, answer_replayed};
use crate::app::submissions::accept::accept_replayed;
use crate::app::submissions::posted::Format;
use crate::clock::now_ms;
use crate::clock::steady::is_doubted;
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
    let mut episode = Episode::to_act_on(app, caller, id).await?;
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
    let episode = blocking(move || {
        let mut log = episode.stored.log()?;
        log.turns.push(Vec::new());
        episode.stored.turn += 1;
        episode.stored.set_log(&log);
        Ok(episode)
    })
    .await?;
    keep_step(app, caller, episode, new.step, LastStep { hash, answer: Value::Null }).await?;
    Episode::of_caller(app, caller, id).await
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
/// The episode is closed for steps first, so that what is submitted is what the last step left. One whose submission
/// was interrupted can be submitted again, also after it has expired.
///
/// # Errors
/// Returns the errors of submitting the same log, and 409 if the episode expired before, or if a step is being made.
pub async fn submit(
    app: &App,
    caller: &Caller,
    id: &str,
    (draft, mut faults): (Option<SubmitEpisode>, Faults),
) -> AppResult<Submitted> {
    let episode = Episode::to_act_on(app, caller, id).await?;
    let Some(new) = draft.filter(|_| faults.is_empty()) else { return Err(AppError::faulty(faults)) };
    if new.transcript_sha256.is_some() && episode.task.is_some() {
        faults.add_at("transcript_sha256", "only the answer to a hidden instance promises a transcript");
        return Err(AppError::faulty(faults));
    }
    if let Some(submission) = episode.row.submission_id {
        return Ok(Submitted::Submission(submission));
    }
    if episode.state() == EpisodeState::Expired && episode.row.submitting_at_ms.is_none() {
        let expired = AppError::conflict("episode-over", episode.why_expired());
        return Err(if is_doubted() { AppError::clock_in_doubt() } else { expired });
    }
    if !app.store.close_episode(id, episode.row.step, now_ms()).await? {
        return Err(AppError::conflict(
            "other-step",
            "another request made a step; read the episode, and submit it again",
        ));
    }
    let (mut stored, turns) = (episode.stored, episode.prompts.len());
    let told = std::mem::take(&mut stored.told);
    let mut body = blocking(move || {
        let mut log = stored.log()?;
        log.turns.resize(turns, Vec::new());
        Ok(json!({ "turns": log.compact_turns(), "profile": Profile::Mindcraft }))
    })
    .await?;
    let submitted = match &episode.row.attempt {
        Attempt::Instance(instance) => {
            body["transcript_sha256"] = json!(new.transcript_sha256);
            let answer = answer_replayed(app, caller, instance, text(body).await?, Format::Json, told).await;
            answer.map(|answer| Submitted::Answer(instance.clone(), Box::new(answer)))
        }
        Attempt::Task { suite_id, number, run_id } => {
            body["task"] = json!(number);
            match run_id {
                Some(run) => body["run"] = json!(run),
                None => body["suite"] = json!(suite_id),
            }
            let body = text(body).await?;
            // A request that is repeated after a crash finds the submission that the first one made. No header can hold
            // this key.
            let once = IdempotencyKey {
                owner: episode.row.owner.unwrap_or_default(),
                key: format!("episode\n{id}"),
                body_hash: hex(&Sha256::digest(&body)),
            };
            accept_replayed(app, caller, body, Format::Json, Some(once), told).await.and_then(|accepted| {
                let one = accepted.submissions.into_iter().next();
                let none = || AppError::internal(&"one submission was posted, and none accepted");
                Ok(Submitted::Submission(one.ok_or_else(none)?.id))
            })
        }
    };
    let submission = match &submitted {
        Ok(Submitted::Submission(id)) => Some(id.as_str()),
        Ok(Submitted::Answer(..)) => None,
        Err(refused) => {
            // After a failure of ours it is not known what was stored, so nothing may be added to it.
            if !refused.is_ours() {
                app.store.reopen_episode(id).await?;
            }
            return submitted;
        }
    };
    app.store.end_episode(id, submission, now_ms()).await?;
    submitted
}

async fn text(body: Value) -> AppResult<Bytes> {
    blocking(move || Ok(Bytes::from(body.to_string()))).await
}
