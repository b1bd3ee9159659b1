//! Registration of entries: enforces the number of entries per owner, the owner's share, and the size of the pool.

use super::db::{query, query_scalar};
use super::entries::own_entries_in;
use super::epochs::epoch_in;
use super::evidence::witness;
use super::idempotency::{IdempotencyKey, PriorRequest};
use super::reservations::{Room, held_in};
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

/// Outcome of a registration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Registered {
    /// The entry is registered.
    New,
    /// The same request registered the entry before, under this identifier.
    Repeated(String),
    /// The idempotency key was used for a different request.
    KeyUsedOtherwise,
    /// The epoch is not open.
    NotOpen,
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

impl Store {
    /// Registers an entry.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn register_entry(
        &self,
        new: &NewEntry<'_>,
        once: Option<&IdempotencyKey>,
        now_ms: i64,
    ) -> StoreResult<Registered> {
        let mut tx = self.begin().await?;
        if let Some(once) = once {
            match once.before(&mut tx, now_ms).await? {
                PriorRequest::Never => once.keep(&mut tx, new.id, now_ms).await?,
                PriorRequest::Done(id) => return Ok(Registered::Repeated(id)),
                PriorRequest::OtherBody => return Ok(Registered::KeyUsedOtherwise),
            }
        }
        let epoch = epoch_in(&mut tx, new.epoch_id).await?;
        let Some(epoch) = epoch.filter(|epoch| epoch.is_open(now_ms)) else { return Ok(Registered::NotOpen) };
        let own = own_entries_in(&mut tx, new.epoch_id, new.tier, new.owner).await?;
        let most = match new.tier {
            Tier::Dev => epoch.rules.dev_entries,
            Tier::Official => epoch.rules.official_entries,
        };
        if own.len() as i64 >= most {
            return Ok(Registered::TooMany(most));
        }
        match held_in(&mut tx, &epoch, now_ms).await?.room_for(new.owner, new.tier, new.runs.into(), &epoch) {
            Room::Enough => {}
            Room::PoolUsedUp => return Ok(Registered::PoolUsedUp),
            Room::ShareUsedUp(most) => return Ok(Registered::ShareUsedUp(most)),
        }
        if let Some(first) = own.first().filter(|_| new.tier == Tier::Official)
            && (first.agent != new.agent || first.configuration_hash != new.configuration_hash)
        {
            return Ok(Registered::OtherConfiguration(first.agent.clone()));
        }
        // An owner with two names would have twice the attempts with one agent. The owner who first registered a
        // configuration, in any tier, keeps it, because its hash may be read on a board.
        let holder: Option<String> = query_scalar(
            "SELECT owner FROM entries WHERE epoch_id = $1 AND configuration_hash = $2 ORDER BY registered_at_ms, id LIMIT 1",
        )
        .bind(new.epoch_id)
        .bind(new.configuration_hash)
        .fetch_optional(&mut tx)
        .await?;
        if new.tier == Tier::Official && holder.is_some_and(|holder| holder != new.owner) {
            return Ok(Registered::ConfigurationTaken);
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
