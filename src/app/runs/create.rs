//! Creating a run.

use serde_json::json;
use uuid::Uuid;

use super::body::{NewRunBody, RunProvenance};
use super::embargo::{NewEmbargo, check_embargo};
use super::read::stored;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::cards::StoredForm;
use crate::app::catalogue::suites::no_suite;
use crate::app::error::{AppError, AppResult};
use crate::app::submissions::accept::key_reused;
use crate::clock::now_ms;
use crate::store::cards::NewCard;
use crate::store::embargoes;
use crate::store::idempotency::{IdempotencyKey, PriorRequest};
use crate::store::keys::Scope;
use crate::store::run_rows::RunRow;
use crate::store::runs::NewRun;
use crate::store::states::RunState;
use plumbline_engine::intake::Faults;

/// A created run.
#[derive(Debug)]
pub struct CreatedRun {
    /// The run as it was at its creation.
    pub run: RunRow,
    /// Whether an earlier request with the same `Idempotency-Key` created it.
    pub is_replayed: bool,
}

/// Creates a run. The draft is `None` if its body is no object; `faults` holds the faults of the body so far.
///
/// # Errors
/// Returns all faults of the body, or a refusal if the caller may not create the run or used the idempotency key for
/// another request.
pub async fn create(
    app: &App,
    caller: &Caller,
    draft: Option<NewRunBody>,
    mut faults: Faults,
    once: Option<&IdempotencyKey>,
) -> AppResult<CreatedRun> {
    caller.require(Scope::Submit)?;
    let mut suite_id = None;
    if let Some(name) = draft.as_ref().and_then(|run| run.suite.as_deref()) {
        match app.find_suite(name).await? {
            Some(entry) => {
                let track = draft.as_ref().and_then(|run| run.track).unwrap_or_default();
                if let Some(detail) = entry.suite.lacks(track) {
                    faults.add_at("track", detail);
                }
                suite_id = Some(entry.id.clone());
            }
            None => faults.add_at("suite", no_suite(&app.catalogue(), name)),
        }
    }
    if let Some(agent) = draft.as_ref().and_then(|run| run.agent.as_deref())
        && app.store.is_alias_of_others(agent.trim(), caller.owner().unwrap_or_default()).await?
    {
        faults.add_at("agent", "is the alias of another owner's run, which is under embargo; choose another name");
    }
    if let Some((embargo, agent)) = draft.as_ref().and_then(|run| Some((run.embargo.as_ref()?, run.agent.as_deref()))) {
        check_embargo(app, caller, embargo, agent, &mut faults).await?;
    }
    let (Some(NewRunBody { agent: Some(agent), metadata, provenance, track, card, embargo, .. }), Some(suite_id), true) =
        (draft, suite_id, faults.is_empty())
    else {
        return Err(AppError::faulty(faults));
    };
    let provenance = provenance.unwrap_or(RunProvenance::SelfReported);
    let metadata = metadata.unwrap_or_else(|| json!({}));
    if provenance == RunProvenance::ReRunByHost {
        caller.require(Scope::Admin)?;
    }
    let id = Uuid::now_v7().to_string();
    let (metadata, owner, provenance) = (&metadata, caller.owner(), provenance.name());
    let track = track.unwrap_or_default();
    let (card, card_id) = (card.map(StoredForm::from), Uuid::now_v7().to_string());
    let card = card.as_ref().map(|StoredForm { card, system_prompt }| NewCard {
        id: &card_id,
        card,
        system_prompt: system_prompt.as_deref(),
        actor: owner,
    });
    let embargo =
        embargo.as_ref().map(|NewEmbargo { alias, until_ms }| embargoes::NewEmbargo { alias, until_ms: *until_ms });
    let new = NewRun { id: &id, agent: &agent, suite_id: &suite_id, metadata, owner, provenance, track, card, embargo };
    let (id, is_replayed) = match app.store.create_run(&new, once, now_ms()).await? {
        PriorRequest::Never => (id, false),
        PriorRequest::Done(id) => (id, true),
        PriorRequest::OtherBody => return Err(key_reused()),
    };
    // The run as it was at its creation, even if the request is repeated later.
    let run = RunRow {
        state: RunState::Open,
        pending: 0,
        graded: 0,
        grader_errors: 0,
        skipped: 0,
        finished_at_ms: None,
        summary: None,
        ..stored(app, &id).await?
    };
    Ok(CreatedRun { run, is_replayed })
}
