//! Registration of entries, with the facts that decide on it.

use super::db::{Tx, query, query_scalar};
use super::entries::{EntryRow, own_entries_in};
use super::epochs::{EpochRow, epoch_in};
use super::evidence::witness;
use super::holdings::{Holding, holdings_in};
use super::idempotency::{IdempotencyKey, PriorRequest};
use super::locks::Lock;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::evidence::{EntryFact, Fact};
use plumbline_engine::hidden::feedback::Tier;

/// Entry to register.
#[derive(Debug, Clone, Copy)]
pub struct NewEntry<'a> {
    /// Identifier of the entry.
    pub id: &'a str,
    /// Identifier of its epoch.
    pub epoch_id: &'a str,
    /// Owner who registers it.
    pub owner: &'a str,
    /// Name of the agent under evaluation.
    pub agent: &'a str,
    /// SHA-256 of the agent's configuration, in hex.
    pub configuration_hash: &'a str,
    /// Tier of the entry.
    pub tier: Tier,
    /// Number of runs.
    pub runs: u32,
}

/// Reason why an entry is not registered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RegistrationRefusal {
    /// The epoch is not open.
    NotOpen,
    /// The round of the epoch's beacon was emitted at this time, in milliseconds since 1970; official entries come
    /// before it.
    AfterBeacon(i64),
    /// The owner already has the maximum number of entries in this tier, which is given.
    TooMany(i64),
    /// The epoch does not have enough specifications left.
    PoolUsedUp,
    /// The owner's official entries are of a different agent or configuration; holds the name of that agent.
    OtherConfiguration(String),
    /// Another owner registered this configuration first.
    ConfigurationTaken,
    /// The runs would exceed the maximum number that one owner may hold, which is given.
    ShareUsedUp(i64),
}

/// Outcome of a registration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Registered {
    /// The entry is registered.
    New,
    /// The same request registered the entry before, under this identifier.
    Repeated(String),
    /// The idempotency key was used for a different request.
    KeyUsedOtherwise,
    /// The entry is not registered, for this reason.
    Refused(RegistrationRefusal),
}

/// Stored facts that decide whether an entry may be registered.
#[derive(Debug, Clone)]
pub struct RegistrationFacts {
    /// Epoch of the entry.
    pub epoch: EpochRow,
    /// The owner's entries to the same tier, in order of registration.
    pub own: Vec<EntryRow>,
    /// Runs that the entries of the epoch hold.
    pub holdings: Vec<Holding>,
    /// Owner who first registered the entry's configuration, in any epoch and tier.
    pub configuration_holder: Option<String>,
    /// Time of the decision, in milliseconds since 1970.
    pub now_ms: i64,
}

/// Decides on a registration from stored facts; the use cases own the rule.
pub type DecideRegistration = fn(&NewEntry<'_>, &RegistrationFacts) -> Result<(), RegistrationRefusal>;

impl Store {
    /// Registers an entry, if `decide` allows it.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn register_entry(
        &self,
        new: &NewEntry<'_>,
        once: Option<&IdempotencyKey>,
        decide: DecideRegistration,
        now_ms: i64,
    ) -> StoreResult<Registered> {
        let mut tx = self.begin().await?;
        tx.lock(
            once.map(IdempotencyKey::lock)
                .into_iter()
                .chain([Lock::Epoch(new.epoch_id), Lock::Configuration(new.configuration_hash)]),
        )
        .await?;
        if let Some(once) = once {
            match once.before(&mut tx, now_ms).await? {
                PriorRequest::Never => once.keep(&mut tx, new.id, now_ms).await?,
                PriorRequest::Done(id) => return Ok(Registered::Repeated(id)),
                PriorRequest::OtherBody => return Ok(Registered::KeyUsedOtherwise),
            }
        }
        if let Err(refusal) = decide(new, &facts_of(&mut tx, new, now_ms).await?) {
            return Ok(Registered::Refused(refusal));
        }
        let fact = EntryFact {
            id: new.id.to_owned(),
            owner: new.owner.to_owned(),
            agent: new.agent.to_owned(),
            configuration_sha256: new.configuration_hash.to_owned(),
            tier: new.tier,
            runs: new.runs,
            registered_at_ms: now_ms,
        };
        let receipt = witness(&mut tx, &*self.signer()?, new.epoch_id, &Fact::Entry(fact)).await?;
        let receipt = serde_json::to_string(&receipt).map_err(|error| StoreError::corrupt("entries", error))?;
        query(
            "INSERT INTO entries (id, epoch_id, owner, agent, configuration_hash, tier, runs, registered_at_ms, receipt)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9)",
        )
        .bind(new.id)
        .bind(new.epoch_id)
        .bind(new.owner)
        .bind(new.agent)
        .bind(new.configuration_hash)
        .bind(new.tier.name())
        .bind(i64::from(new.runs))
        .bind(now_ms)
        .bind(receipt)
        .execute(&mut tx)
        .await?;
        commit(tx, "register_entry").await?;
        Ok(Registered::New)
    }

    /// Returns the receipt of an entry's registration, as JSON; none for entries that are older than these receipts.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn receipt_of_entry(&self, id: &str) -> StoreResult<Option<String>> {
        let found = query_scalar("SELECT receipt FROM entries WHERE id = $1").bind(id);
        Ok(found.fetch_optional(&self.readers).await?.flatten())
    }
}

/// Reads the facts that decide whether an entry may be registered.
async fn facts_of(tx: &mut Tx, new: &NewEntry<'_>, now_ms: i64) -> StoreResult<RegistrationFacts> {
    let epoch = epoch_in(tx, new.epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
    let own = own_entries_in(tx, new.epoch_id, new.tier, new.owner).await?;
    let holdings = holdings_in(tx, new.epoch_id).await?;
    let configuration_holder: Option<String> = query_scalar(
        "SELECT owner FROM entries WHERE configuration_hash = $1 AND (epoch_id = $2 OR owner <> '')
         ORDER BY registered_at_ms, id LIMIT 1",
    )
    .bind(new.configuration_hash)
    .bind(new.epoch_id)
    .fetch_optional(tx)
    .await?;
    Ok(RegistrationFacts { epoch, own, holdings, configuration_holder, now_ms })
}
