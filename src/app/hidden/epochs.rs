//! Epochs: their state, and what they reveal after they close.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures_util::stream::{self, BoxStream};

use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::clock::steady::is_doubted;
use crate::clock::{now_ms, rfc3339};
use crate::store::entries::EntryRow;
use crate::store::epochs::EpochRow;
use crate::store::instances::{EpochCounts, InstanceRow};
use crate::store::location::Location;
use crate::store::secrets::EpochSecret;
use crate::store::{Store, StoreResult};
use plumbline_engine::grading::ProblemScores;
use plumbline_engine::hidden::reveal::{Reveal, RevealedEntry, RevealedInstance, revealed};

/// An epoch as it is now.
#[derive(Debug)]
pub struct EpochStatus {
    /// Stored epoch.
    pub row: EpochRow,
    /// Counts of its entries and instances.
    pub counts: EpochCounts,
    /// State: `committed`, `open` or `closed`.
    pub state: &'static str,
}

/// Answer of a closed epoch.
#[derive(Debug)]
pub struct RevealedAnswer {
    /// Identifier of the instance.
    pub instance: String,
    /// Log that answered it, as canonical JSON.
    pub log: Vec<u8>,
}

/// Returns all epochs, the last to open first.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn epochs(app: &App) -> AppResult<Vec<EpochStatus>> {
    let mut all = Vec::new();
    for row in app.store.epochs().await? {
        all.push(status(app, row).await?);
    }
    Ok(all)
}

/// Returns the epoch with this name.
///
/// # Errors
/// Returns an error (404) if there is none.
pub async fn epoch(app: &App, id: &str) -> AppResult<EpochStatus> {
    status(app, stored_epoch(app, id).await?).await
}

async fn status(app: &App, row: EpochRow) -> AppResult<EpochStatus> {
    let counts = app.store.epoch_counts(row.id(), row.commitment.specifications).await?;
    Ok(EpochStatus { state: row.state(now_ms()), counts, row })
}

/// Returns the row of the epoch with this name.
///
/// # Errors
/// Returns an error (404) if there is none.
pub(super) async fn stored_epoch(app: &App, id: &str) -> AppResult<EpochRow> {
    let row = app.store.epoch(id).await?;
    row.ok_or_else(|| AppError::not_found(format!("there is no epoch {id:?}; /v1/epochs lists them")))
}

/// Creates the failure that says why the epoch is not open: a conflict, unless the clock by which it is not open is in
/// doubt.
pub(super) fn not_open(epoch: &EpochRow) -> AppError {
    let detail = match &epoch.closed {
        Some((_, reason)) => format!("the epoch is closed: {reason}"),
        None if is_doubted() => return AppError::clock_in_doubt(),
        None if epoch.is_over(now_ms()) => {
            format!("the epoch closed at {}", rfc3339(epoch.commitment.closes_at_ms))
        }
        None => format!("the epoch opens at {}", rfc3339(epoch.commitment.opens_at_ms)),
    };
    AppError::conflict("epoch-not-open", detail)
}

/// Returns the secret that an epoch draws from.
///
/// # Errors
/// Returns an error if the secret is not there, or is not the one committed to. The operator may put it back, and
/// another node may have it, so nothing is closed.
pub(super) async fn secret_of(store: &Store, epoch: &EpochRow) -> AppResult<Arc<EpochSecret>> {
    if let Some(secret) = store.epoch_secret(epoch).await? {
        return Ok(secret);
    }
    let (detail, seconds) = match store.location() {
        Location::Server(_) => ("this node lacks the key of the epoch; send the request again, to another node", 1),
        Location::File(_) | Location::Memory | Location::Unreadable(_) => {
            ("the service lacks the key of the epoch; its operator must put it back", 60)
        }
    };
    Err(AppError::new(Kind::NotReady, detail).retry_after(seconds))
}

/// Returns the epoch and its secret if the epoch is over, fully graded, and its key is available.
async fn sealed_epoch(app: &App, id: &str) -> AppResult<(EpochRow, Arc<EpochSecret>)> {
    let row = stored_epoch(app, id).await?;
    let now = now_ms();
    if !row.is_over(now) {
        let detail =
            format!("the epoch closes at {}; nothing is revealed before that", rfc3339(row.commitment.closes_at_ms));
        return Err(AppError::conflict("epoch-not-over", detail));
    }
    if row.settled_at_ms.is_none() {
        let detail = "the epoch is over; its last answers are being graded, and then its results are sealed";
        return Err(AppError::conflict("still-grading", detail).retry_after(1));
    }
    let secret = secret_of(&app.store, &row).await?;
    Ok((row, secret))
}

/// Reveals everything that a closed epoch kept secret, as JSON of a [`Reveal`]. It never changes again.
///
/// # Errors
/// Returns an error if the epoch does not exist, is not over, is still being graded, or if its key is not there.
pub async fn reveal(app: &App, id: &str) -> AppResult<Vec<u8>> {
    let (row, secret) = sealed_epoch(app, id).await?;
    let entries = app.store.entries(row.id()).await?;
    let mut grades: BTreeMap<String, Option<ProblemScores>> = BTreeMap::new();
    for entry in &entries {
        let outcomes = app.store.outcomes_of_entry(&entry.id).await?;
        grades.extend(outcomes.into_iter().map(|outcome| (outcome.instance, outcome.scores)));
    }
    let rows = app.store.instances_of_epoch(row.id()).await?;
    let instances = rows.into_iter().map(|own| {
        let scores = grades.remove(&own.id).flatten();
        revealed_instance(own, scores)
    });
    let instances: Vec<RevealedInstance> = instances.collect();
    let entries = entries.into_iter().map(revealed_entry).collect();
    let receipts = Some(app.store.receipts_of_epoch(row.id()).await?);
    let made = tokio::task::spawn_blocking(move || {
        let drawn = secret.pool.specifications.iter();
        let specifications = drawn.map(|own| revealed(&secret.pool_key, own.clone())).collect();
        let reveal = Reveal {
            commitment: row.commitment,
            key: secret.key.expose(),
            pool: row.pool,
            specifications,
            entries,
            instances,
            receipts,
        };
        serde_json::to_vec(&reveal)
    });
    made.await.map_err(|error| AppError::internal(&error))?.map_err(|error| AppError::internal(&error))
}

fn revealed_entry(row: EntryRow) -> RevealedEntry {
    RevealedEntry {
        id: row.id,
        agent: row.agent,
        configuration_hash: row.configuration_hash,
        tier: row.tier,
        runs: row.runs,
        registered_at_ms: row.registered_at_ms,
        finalized_at_ms: row.finalized_at_ms,
        owner: Some(row.owner),
        completed_at_ms: row.completed_at_ms,
    }
}

fn revealed_instance(own: InstanceRow, scores: Option<ProblemScores>) -> RevealedInstance {
    RevealedInstance {
        ordinal: own.ordinal,
        entry: own.entry_id,
        nonce: own.nonce,
        run: own.run,
        family: own.family,
        index: own.family_index,
        leaf: own.leaf,
        log_sha256: own.log_hash,
        overall: scores.as_ref().map(ProblemScores::overall),
        scores: scores.map(|scores| scores.rows),
        transcript_sha256: own.transcript_hash,
        transcript_checked: own.transcript_checked_ms.is_some(),
        id: own.id,
    }
}

/// Returns the logs that answered a closed epoch's instances, a few at a time, in order of issue.
///
/// # Errors
/// Returns an error if the epoch does not exist, is not over, is still being graded, or if its key is not there. The stream
/// ends with an error if the database fails.
pub async fn revealed_answers(app: &App, id: &str) -> AppResult<BoxStream<'static, StoreResult<Vec<RevealedAnswer>>>> {
    const AT_ONCE: i64 = 10;
    let (row, _secret) = sealed_epoch(app, id).await?;
    let pages = stream::try_unfold((app.store.clone(), row, 0), |(store, row, after)| async move {
        let page = store.answers(row.id(), after, AT_ONCE).await?;
        let Some((last, _, _)) = page.last() else { return Ok(None) };
        let last = *last;
        let answers = page.into_iter().map(|(_, instance, log)| RevealedAnswer { instance, log }).collect();
        Ok(Some((answers, (store, row, last))))
    });
    Ok(Box::pin(pages))
}
