//! Entries to an epoch. An entry is registered before its owner sees any instance, then drawn, answered and finalized.

use serde_json::Value;
use uuid::Uuid;

use super::body::NewEntryBody;
use super::epochs::{not_open, stored_epoch};
use super::receipts::given;
use super::registration::decide_registration;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::submissions::accept::key_reused;
use crate::clock::steady::{is_doubted, steady_now_ms};
use crate::clock::{now_ms, rfc3339};
use crate::store::entries::{EntryRow, InstanceOutcome};
use crate::store::epochs::EpochRow;
use crate::store::idempotency::IdempotencyKey;
use crate::store::keys::Scope;
use crate::store::registration::{NewEntry, Registered, RegistrationRefusal};
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::feedback::{Counts, Outcome, Tier, told};
use plumbline_engine::intake::Faults;

/// An entry as it is now, with as much of its result as the feedback of its tier allows.
#[derive(Debug)]
pub struct EntryStatus {
    /// Stored entry.
    pub row: EntryRow,
    /// State: `registered`, `finalized` or `complete`.
    pub state: &'static str,
    /// Number of issued instances.
    pub issued: usize,
    /// Number of answered instances.
    pub answered: usize,
    /// Result, as far as it is released.
    pub result: Value,
}

/// Registered entry.
#[derive(Debug)]
pub struct RegisteredEntry {
    /// The entry.
    pub entry: EntryStatus,
    /// Receipt of the registration; none for entries that are older than these receipts.
    pub receipt: Option<GivenReceipt>,
    /// Whether an earlier request with the same `Idempotency-Key` already had the effect.
    pub is_replayed: bool,
}

/// Registers an entry before any instance is seen. The draft is `None` if its body is no object; `faults` holds the
/// faults of the body.
///
/// # Errors
/// Returns all faults of the entry, a conflict if the rules of the epoch do not allow it, and a refusal if the caller
/// may not submit.
pub async fn register_entry(
    app: &App,
    caller: &Caller,
    epoch: &str,
    draft: Option<NewEntryBody>,
    faults: Faults,
    once: Option<&IdempotencyKey>,
) -> AppResult<RegisteredEntry> {
    caller.require(Scope::Submit)?;
    let epoch = stored_epoch(app, epoch).await?;
    let (
        Some(NewEntryBody {
            agent: Some(agent),
            configuration_sha256: Some(configuration_hash),
            tier: Some(tier),
            runs: Some(runs),
        }),
        true,
    ) = (draft, faults.is_empty())
    else {
        return Err(AppError::faulty(faults));
    };
    if is_doubted() {
        return Err(AppError::clock_in_doubt());
    }
    let id = Uuid::now_v7().to_string();
    let new = NewEntry {
        id: &id,
        epoch_id: epoch.id(),
        owner: caller.owner().unwrap_or_default(),
        agent: agent.trim(),
        configuration_hash: &configuration_hash,
        tier,
        runs: u32::try_from(runs).expect("the body's reader bounds the number of runs"),
    };
    let (registered, is_replayed) = match app.store.register_entry(&new, once, decide_registration, now_ms()).await? {
        Registered::New => (id, false),
        Registered::Repeated(before) => (before, true),
        Registered::KeyUsedOtherwise => return Err(key_reused()),
        Registered::Refused(refusal) => return Err(refused(&refusal, tier, &epoch)),
    };
    let receipt = given(app.store.receipt_of_entry(&registered).await?.as_deref())?;
    Ok(RegisteredEntry { entry: entry(app, &registered).await?, receipt, is_replayed })
}

/// Creates the conflict for an entry that may not be registered.
fn refused(refusal: &RegistrationRefusal, tier: Tier, epoch: &EpochRow) -> AppError {
    match refusal {
        RegistrationRefusal::NotOpen => not_open(epoch),
        RegistrationRefusal::AfterBeacon(at_ms) => {
            let detail = format!(
                "official entries of this epoch were registered until {}, when the beacon's round was emitted; the dev tier is open",
                rfc3339(*at_ms)
            );
            AppError::conflict("registration-over", detail)
        }
        RegistrationRefusal::TooMany(most) => {
            let tier = tier.name();
            let detail =
                format!("the owner already has {most} entries of the tier {tier:?} in this epoch, the maximum");
            AppError::conflict("no-entries-left", detail)
        }
        RegistrationRefusal::PoolUsedUp => {
            let detail = "the epoch has too few specifications left; half of them are reserved for official entries";
            AppError::conflict("pool-used-up", detail)
        }
        RegistrationRefusal::ShareUsedUp(most) => {
            let detail = format!(
                "one owner may hold at most {most} runs of this epoch's pool, drawn or reserved; what is drawn stays used, and a reservation ends \
                 when its entry is finalized, or after {} s",
                epoch.rules.reservation_ms.unwrap_or_default() / 1_000
            );
            AppError::conflict("share-used-up", detail)
        }
        RegistrationRefusal::ConfigurationTaken => {
            let detail = "another owner entered this configuration before, in this epoch or another one; only one owner may \
                          enter it";
            AppError::conflict("configuration-taken", detail)
        }
        RegistrationRefusal::OtherConfiguration(agent) => {
            let detail = format!(
                "the owner's official entries in this epoch have another agent or configuration (agent {agent:?}); \
                 official entries are pooled, so all of them must have the same"
            );
            AppError::conflict("another-configuration", detail)
        }
    }
}

/// Returns an entry with its state and, as far as it is released, its result.
///
/// # Errors
/// Returns an error (404) if there is no such entry.
pub async fn entry(app: &App, id: &str) -> AppResult<EntryStatus> {
    let row = stored_entry(app, id).await?;
    let epoch = stored_epoch(app, &row.epoch_id).await?;
    let instances = app.store.instances_of_entry(id).await?;
    let mut result = Value::Null;
    if row.completed_at_ms.is_some() {
        let outcomes = outcomes_of(app.store.outcomes_of_entry(id).await?, &row, &epoch.commitment);
        result = told(row.tier.feedback(epoch.commitment.dev_feedback), epoch.closed.is_some(), &outcomes);
    }
    Ok(EntryStatus {
        state: match (row.finalized_at_ms, row.completed_at_ms) {
            (_, Some(_)) => "complete",
            (Some(_), None) => "finalized",
            (None, None) => "registered",
        },
        issued: instances.len(),
        answered: instances.iter().filter(|own| own.submission_id.is_some()).count(),
        row,
        result,
    })
}

/// Returns the outcomes of an entry, with a failed one for each instance of the runs that were never drawn.
fn outcomes_of(stored: Vec<InstanceOutcome>, entry: &EntryRow, commitment: &Commitment) -> Vec<Outcome> {
    let outcome = |own: InstanceOutcome| {
        let leaf = u32::try_from(own.leaf).expect("a leaf was stored from a number of 32 bits");
        let counts = commitment.counts(entry.tier, &own.salt, leaf);
        Outcome { counts, instance: own.instance, scores: own.scores }
    };
    let mut outcomes: Vec<Outcome> = stored.into_iter().map(outcome).collect();
    let hidden = outcomes.iter().filter(|own| own.counts != Counts::Sibling).count();
    let all = entry.runs as usize * commitment.instances_per_run as usize;
    let undrawn = Outcome { counts: Counts::Told, instance: String::new(), scores: None };
    outcomes.resize(outcomes.len() + all.saturating_sub(hidden), undrawn);
    outcomes
}

pub(in crate::app) async fn stored_entry(app: &App, id: &str) -> AppResult<EntryRow> {
    let row = app.store.entry(id).await?;
    row.ok_or_else(|| AppError::not_found(format!("there is no entry {id:?}")))
}

/// Returns the entry if the caller may act on it.
///
/// # Errors
/// Returns an error if the entry belongs to another owner (403) or does not exist (404).
pub(super) async fn entrants_entry(app: &App, caller: &Caller, id: &str) -> AppResult<EntryRow> {
    let row = stored_entry(app, id).await?;
    require_entrant(caller, &row, "entry")?;
    Ok(row)
}

/// Checks that the caller may act on something that belongs to the owner of an entry.
///
/// # Errors
/// Returns an error (403) if it belongs to another owner.
pub(super) fn require_owner(caller: &Caller, entry: &EntryRow, what: &str) -> AppResult<()> {
    caller.require_own(Some(entry.owner.as_str()).filter(|owner| !owner.is_empty()), what)
}

/// Checks that the caller is the owner of an entry itself. What is drawn and answered is signed as the entrant's, so
/// an operator's key may not do it in the owner's place.
///
/// # Errors
/// Returns an error (403) if the entry belongs to another owner.
pub(super) fn require_entrant(caller: &Caller, entry: &EntryRow, what: &str) -> AppResult<()> {
    require_owner(caller, entry, what)?;
    if entry.owner.is_empty() || caller.owner() == Some(&entry.owner) {
        return Ok(());
    }
    let detail = format!("the {what} belongs to another owner, and a key of an operator does not act for its entrant");
    Err(AppError::new(Kind::Forbidden, detail))
}

/// Finalizes an entry, which then takes no more answers.
///
/// # Errors
/// Returns an error if there is no such entry, or if the caller may not act on it.
pub async fn finalize_entry(app: &App, caller: &Caller, id: &str) -> AppResult<EntryStatus> {
    caller.require(Scope::Submit)?;
    entrants_entry(app, caller, id).await?;
    app.store.finalize_entry(id, steady_now_ms()).await?;
    entry(app, id).await
}
