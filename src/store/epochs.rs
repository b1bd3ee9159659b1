//! Epochs: their commitments, and when they are over.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, PoisonError};

use super::db::{Row, Tx, query};
use super::locks::Lock;
use super::order_of_steps::{StepsOf, not_before};
use super::pending::publish;
use super::receipts::announce;
use super::secrets::EpochSecret;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::announcements::{Announcement, EpochFact};
use plumbline_engine::hidden::beacon::BoundPool;
use plumbline_engine::hidden::commitment::{Commitment, Rules};

/// Suite under which answers to hidden instances are stored. It has no tasks of its own, so no catalogue lists it.
pub const HIDDEN_SUITE: &str = "hidden@1";

/// Rules of an epoch, as stored in its row next to the commitment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpochRules {
    /// Time allowed to answer an instance, in milliseconds.
    pub instance_ms: i64,
    /// Number of entries that an owner may register in the dev tier.
    pub dev_entries: i64,
    /// Number of entries that an owner may register in the official tier.
    pub official_entries: i64,
    /// Bits that may be released before the epoch closes.
    pub budget_bits: f64,
    /// Number of runs that one owner may hold, drawn or reserved; none for epochs that are older than this rule.
    pub owner_runs: Option<i64>,
    /// Time for which a run that is not drawn keeps its reservation in the pool, in milliseconds; if none, until the
    /// epoch ends.
    pub reservation_ms: Option<i64>,
}

impl From<&Rules> for EpochRules {
    fn from(rules: &Rules) -> Self {
        Self {
            instance_ms: i64::from(rules.instance_seconds) * 1_000,
            dev_entries: rules.dev_entries_per_owner.into(),
            official_entries: rules.official_entries_per_owner.into(),
            budget_bits: rules.budget_bits.into(),
            owner_runs: Some(rules.runs_per_owner.into()),
            reservation_ms: Some(i64::from(rules.reservation_seconds) * 1_000),
        }
    }
}

/// Row of an epoch.
#[derive(Debug, Clone)]
pub struct EpochRow {
    /// Published commitment.
    pub commitment: Commitment,
    /// Rules of the epoch.
    pub rules: EpochRules,
    /// Bits released so far.
    pub released_bits: f64,
    /// Time of creation, in milliseconds since 1970.
    pub created_at_ms: i64,
    /// Time and reason of closing; a closed epoch stays closed, whatever the clock says.
    pub closed: Option<(i64, String)>,
    /// The pool, once it is made, if the epoch is bound to a beacon.
    pub pool: Option<BoundPool>,
    /// Time at which it was settled: all answers graded, all receipts published.
    pub settled_at_ms: Option<i64>,
}

impl EpochRow {
    /// Returns the name of the epoch.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.commitment.epoch
    }

    /// Returns whether it is over, on time or closed early.
    #[must_use]
    pub fn is_over(&self, now_ms: i64) -> bool {
        self.closed.is_some() || now_ms >= self.commitment.closes_at_ms
    }

    /// Returns whether it accepts entries and issues instances.
    #[must_use]
    pub fn is_open(&self, now_ms: i64) -> bool {
        now_ms >= self.commitment.opens_at_ms && !self.is_over(now_ms)
    }

    /// Returns the number of the beacon's round that is due, but nobody has brought; `None` if there is none.
    #[must_use]
    pub fn lacks_round(&self, now_ms: i64) -> Option<u64> {
        let beacon = self.commitment.beacon.as_ref().filter(|_| self.pool.is_none() && !self.is_over(now_ms))?;
        (now_ms >= beacon.emitted_at_ms()).then_some(beacon.round)
    }

    /// Returns the state: `committed`, `open` or `closed`.
    #[must_use]
    pub fn state(&self, now_ms: i64) -> &'static str {
        match (self.is_over(now_ms), self.is_open(now_ms)) {
            (true, _) => "closed",
            (false, true) => "open",
            (false, false) => "committed",
        }
    }
}

/// Cache of the secrets that epochs draw from.
#[derive(Debug, Default)]
pub(super) struct SecretsRead {
    known: Mutex<HashMap<String, Arc<EpochSecret>>>,
    /// Epochs whose secret is not there, which is logged once each time.
    missing: Mutex<HashSet<String>>,
    /// Held while a secret is read, which may draw a pool.
    reading: tokio::sync::Mutex<()>,
}

macro_rules! select_epoch {
    ($rest:literal) => {
        concat!(
            "SELECT commitment, instance_ms, dev_entries, official_entries, budget_bits, released_bits, created_at_ms,
                    closed_at_ms, closed_reason, owner_runs, reservation_ms, settled_at_ms, pool FROM epochs ",
            $rest
        )
    };
}

fn read(row: &Row) -> StoreResult<EpochRow> {
    let closed_at_ms: Option<i64> = row.get("closed_at_ms")?;
    let pool: Option<&str> = row.get("pool")?;
    let pool = pool.map(serde_json::from_str).transpose().map_err(|error| StoreError::corrupt("epochs", error))?;
    let reason: Option<String> = row.get("closed_reason")?;
    Ok(EpochRow {
        commitment: serde_json::from_str(row.get("commitment")?)
            .map_err(|error| StoreError::corrupt("epochs", error))?,
        rules: EpochRules {
            instance_ms: row.get("instance_ms")?,
            dev_entries: row.get("dev_entries")?,
            official_entries: row.get("official_entries")?,
            budget_bits: row.get("budget_bits")?,
            owner_runs: row.get("owner_runs")?,
            reservation_ms: row.get("reservation_ms")?,
        },
        released_bits: row.get("released_bits")?,
        created_at_ms: row.get("created_at_ms")?,
        closed: closed_at_ms.zip(reason),
        pool,
        settled_at_ms: row.get("settled_at_ms")?,
    })
}

/// Reads an epoch within the transaction.
pub(super) async fn epoch_in(tx: &mut Tx, id: &str) -> StoreResult<Option<EpochRow>> {
    let row = query(select_epoch!("WHERE id = $1")).bind(id).fetch_optional(tx).await?;
    row.as_ref().map(read).transpose()
}

/// Marks an epoch whose time has passed as closed, so that it stays closed whatever the clock says later.
pub(super) async fn seal_in(tx: &mut Tx, id: &str) -> StoreResult<()> {
    query(
        "UPDATE epochs SET closed_at_ms = closes_at_ms, closed_reason = 'its time is over'
         WHERE id = $1 AND closed_at_ms IS NULL",
    )
    .bind(id)
    .execute(tx)
    .await?;
    Ok(())
}

/// Closes an epoch that is neither closed nor past its time; returns whether it did.
pub(super) async fn close_in(tx: &mut Tx, id: &str, reason: &str, now_ms: i64) -> StoreResult<bool> {
    let now_ms = not_before(tx, StepsOf::Epoch(id), now_ms).await?;
    let closed = query(
        "UPDATE epochs SET closed_at_ms = $2, closed_reason = $3 WHERE id = $1 AND closed_at_ms IS NULL AND closes_at_ms > $2",
    )
    .bind(id)
    .bind(now_ms)
    .bind(reason)
    .execute(tx)
    .await?;
    Ok(closed > 0)
}

impl Store {
    /// Announces an epoch: first saves its secret to a file beside the database, then stores its commitment. Returns
    /// false if an epoch of this name exists.
    ///
    /// # Errors
    /// Returns an error if a file or the database fails.
    pub async fn create_epoch(
        &self,
        commitment: &Commitment,
        rules: &EpochRules,
        secret: &EpochSecret,
        now_ms: i64,
    ) -> StoreResult<bool> {
        if self.epoch(&commitment.epoch).await?.is_some() || !self.secrets.put_epoch(&commitment.epoch, secret)? {
            return Ok(false);
        }
        let text = serde_json::to_string(commitment).map_err(|error| StoreError::corrupt("epochs", error))?;
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        tx.lock([Lock::Epoch(&commitment.epoch), Lock::Suites, Lock::Order]).await?;
        query(
            "INSERT INTO suites (id, name, version, task_count, content_hash, created_at_ms)
             VALUES ($1, 'hidden', 1, 0, '', $2) ON CONFLICT (id) DO NOTHING",
        )
        .bind(HIDDEN_SUITE)
        .bind(now_ms)
        .execute(&mut tx)
        .await?;
        query(
            "INSERT INTO epochs (id, commitment, opens_at_ms, closes_at_ms, instance_ms, dev_entries, official_entries,
                                 budget_bits, created_at_ms, owner_runs, reservation_ms)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)",
        )
        .bind(&commitment.epoch)
        .bind(text)
        .bind(commitment.opens_at_ms)
        .bind(commitment.closes_at_ms)
        .bind(rules.instance_ms)
        .bind(rules.dev_entries)
        .bind(rules.official_entries)
        .bind(rules.budget_bits)
        .bind(now_ms)
        .bind(rules.owner_runs)
        .bind(rules.reservation_ms)
        .execute(&mut tx)
        .await?;
        let fact = EpochFact { commitment: Box::new(commitment.clone()), committed_at_ms: now_ms };
        announce(&mut tx, &signer, &Announcement::Epoch(fact)).await?;
        commit(tx, "create_epoch").await?;
        Ok(true)
    }

    /// Publishes the pool of an epoch that is bound to a beacon, unless it has one. Returns the published one; `None`
    /// if the epoch is over. The receipts of registrations enter the log before the pool, which shows that they came
    /// before it.
    ///
    /// # Errors
    /// Returns an error if the database fails, or this node cannot sign.
    pub async fn publish_pool(&self, pool: &BoundPool) -> StoreResult<Option<BoundPool>> {
        let signer = self.signer()?;
        let text = serde_json::to_string(pool).map_err(|error| StoreError::corrupt("epochs", error))?;
        let mut tx = self.begin().await?;
        tx.lock([Lock::Epoch(&pool.epoch), Lock::Order]).await?;
        let epoch = epoch_in(&mut tx, &pool.epoch).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
        if epoch.pool.is_some() || epoch.is_over(pool.made_at_ms) {
            return Ok(epoch.pool);
        }
        publish(&mut tx, Some(&pool.epoch)).await?;
        query("UPDATE epochs SET pool = $2 WHERE id = $1").bind(&pool.epoch).bind(text).execute(&mut tx).await?;
        announce(&mut tx, &signer, &Announcement::Pool(pool.clone())).await?;
        commit(tx, "publish_pool").await?;
        // What is known of the secret has no pool.
        self.secrets_read.known.lock().unwrap_or_else(PoisonError::into_inner).remove(&pool.epoch);
        Ok(Some(pool.clone()))
    }

    /// Returns the epoch of this name.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn epoch(&self, id: &str) -> StoreResult<Option<EpochRow>> {
        let row = query(select_epoch!("WHERE id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read).transpose()
    }

    /// Returns all epochs, the last to open first.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn epochs(&self) -> StoreResult<Vec<EpochRow>> {
        let rows = query(select_epoch!("ORDER BY opens_at_ms DESC, id")).fetch_all(&self.readers).await?;
        rows.iter().map(read).collect()
    }

    /// Closes an epoch before its time. Returns false if it is over already.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn close_epoch(&self, id: &str, reason: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Epoch(id)]).await?;
        let is_closed = close_in(&mut tx, id, reason, now_ms).await?;
        commit(tx, "close_epoch").await?;
        Ok(is_closed)
    }

    /// Returns the secret that an epoch draws from; none if it is lost, or is not the one committed to. Then the log says
    /// so, once.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read.
    pub async fn epoch_secret(&self, epoch: &EpochRow) -> StoreResult<Option<Arc<EpochSecret>>> {
        let held = || self.secrets_read.known.lock().unwrap_or_else(PoisonError::into_inner);
        // Another node may have published the pool since the secret was read.
        let is_whole = |secret: &&Arc<EpochSecret>| epoch.pool.is_none() || !secret.pool.specifications.is_empty();
        if let Some(secret) = held().get(epoch.id()).filter(is_whole) {
            return Ok(Some(Arc::clone(secret)));
        }
        let _alone = self.secrets_read.reading.lock().await;
        if let Some(secret) = held().get(epoch.id()).filter(is_whole) {
            return Ok(Some(Arc::clone(secret)));
        }
        let (secrets, epoch) = (self.secrets.clone(), epoch.clone());
        let id = epoch.id().to_owned();
        let read = tokio::task::spawn_blocking(move || secrets.epoch(&epoch.commitment, epoch.pool.as_ref()));
        let read = read.await.map_err(|error| StoreError::failed("reading a secret", error))??;
        let missing = || self.secrets_read.missing.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(secret) = read.map(Arc::new) else {
            if missing().insert(id.clone()) {
                tracing::error!(
                    epoch = id,
                    folder = %self.secrets.folder().display(),
                    "the folder of secrets does not hold the key that the epoch is committed to: put it back"
                );
            }
            return Ok(None);
        };
        missing().remove(&id);
        held().insert(id, Arc::clone(&secret));
        Ok(Some(secret))
    }
}
