//! Registering an entry: within an owner's entries, its share, and the pool.

use super::entries::own_entries_in;
use super::epochs::epoch_in;
use super::evidence::witness;
use super::idempotency::{Before, Once};
use super::reservations::{Room, held_in};
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::evidence::{EntryFact, Fact};
use plumbline_engine::hidden::feedback::Tier;

/// An entry to register.
#[derive(Debug, Clone, Copy)]
pub struct NewEntry<'a> {
    /// Its id.
    pub id: &'a str,
    /// Its epoch.
    pub epoch_id: &'a str,
    /// Who registers it.
    pub owner: &'a str,
    /// Who is evaluated.
    pub agent: &'a str,
    /// SHA-256 of the configuration.
    pub configuration_hash: &'a str,
    /// Its tier.
    pub tier: Tier,
    /// Runs.
    pub runs: u32,
}

/// What came of registering.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Registered {
    /// It is registered.
    New,
    /// The same request registered it before, under this id.
    Before(String),
    /// The request's key was used for another one.
    KeyUsedOtherwise,
    /// The epoch is not open.
    NotOpen,
    /// The owner has as many entries of this tier as are allowed.
    TooMany(i64),
    /// The epoch has not so many specifications left.
    PoolUsedUp,
    /// The owner's official entries are of another agent or configuration, named here.
    OtherConfiguration(String),
    /// Another owner entered this configuration first.
    ConfigurationTaken,
    /// The owner holds as many runs as one owner may.
    ShareUsedUp(i64),
}

impl Store {
    /// Registers an entry.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn register_entry(
        &self,
        new: &NewEntry<'_>,
        once: Option<&Once>,
        now_ms: i64,
    ) -> StoreResult<Registered> {
        let mut tx = self.begin().await?;
        if let Some(once) = once {
            match once.before(&mut tx, now_ms).await? {
                Before::Never => once.keep(&mut tx, new.id, now_ms).await?,
                Before::Done(id) => return Ok(Registered::Before(id)),
                Before::OtherBody => return Ok(Registered::KeyUsedOtherwise),
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
        // Who has two names would have twice the attempts with one agent.
        // Whoever first entered a configuration, in whatever tier, keeps it: its hash may be read on a board.
        let holder: Option<String> = sqlx::query_scalar(
            "SELECT owner FROM entries WHERE epoch_id = $1 AND configuration_hash = $2 ORDER BY registered_at_ms, id LIMIT 1",
        )
        .bind(new.epoch_id)
        .bind(new.configuration_hash)
        .fetch_optional(&mut *tx)
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
        sqlx::query(
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
        .execute(&mut *tx)
        .await?;
        commit(tx, "register_entry").await?;
        Ok(Registered::New)
    }

    /// The receipt of an entry's registration, as JSON; none of entries made before there were such.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn receipt_of_entry(&self, id: &str) -> StoreResult<Option<String>> {
        let found = sqlx::query_scalar("SELECT receipt FROM entries WHERE id = $1").bind(id);
        Ok(found.fetch_optional(&self.readers).await?.flatten())
    }
}
