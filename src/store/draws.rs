//! Draws: the instances of an entry's run, issued together, with the facts that decide on them.

use std::collections::HashSet;

use super::db::{Tx, query, query_as};
use super::entries::{EntryRow, entry_in};
use super::epochs::{EpochRow, epoch_in};
use super::evidence::witness;
use super::holdings::{Holding, holdings_in};
use super::instances::{InstanceRow, of_run};
use super::locks::Lock;
use super::secrets::EpochSecret;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::evidence::{DrawFact, Fact, GivenReceipt, prompts_hash};
use plumbline_engine::hidden::issue::Lot;
use plumbline_engine::hidden::pool::Specification;
use plumbline_engine::hidden::siblings::Siblings;
use plumbline_engine::tasks::{Task, hex};

/// Draw of a run's instances.
#[derive(Debug, Clone, Copy)]
pub struct NewDraw<'a> {
    /// Identifier of the entry.
    pub entry_id: &'a str,
    /// Number of the run within the entry, from 1.
    pub run: u32,
    /// Nonce that the entrant chose for the run.
    pub nonce: &'a str,
    /// Secret of the entry's epoch.
    pub secret: &'a EpochSecret,
    /// Lot of the run, from the same secret.
    pub lot: &'a Lot<'a>,
    /// The public list of siblings, if the epoch has any.
    pub siblings: Option<&'static Siblings>,
}

impl NewDraw<'_> {
    /// Returns the specification behind a leaf of the pool, or of the list of siblings.
    fn specification(&self, commitment: &Commitment, leaf: u32) -> Option<&Specification> {
        let pool = &self.secret.pool;
        if commitment.is_sibling(leaf) {
            return self.siblings?.specification(commitment, leaf);
        }
        pool.specifications.get(leaf as usize)
    }
}

/// Stored facts that decide on a draw.
#[derive(Debug, Clone)]
pub struct DrawFacts {
    /// Entry of the run.
    pub entry: EntryRow,
    /// Epoch of the entry.
    pub epoch: EpochRow,
    /// Nonce with which the run was drawn before; none if it was not.
    pub earlier_nonce: Option<String>,
    /// Runs that the entries of the epoch hold.
    pub holdings: Vec<Holding>,
    /// Leaves that the epoch has issued.
    pub issued_leaves: HashSet<u32>,
    /// Those among them that the entry has.
    pub own_leaves: HashSet<u32>,
    /// Time of the decision, in milliseconds since 1970.
    pub now_ms: i64,
}

/// Leaf of the pool that becomes an instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DrawnLeaf {
    /// Family of the specification.
    pub family: String,
    /// Index among the family's instances in the run, from 0.
    pub family_index: u32,
    /// Leaf of the specification in the pool.
    pub leaf: u32,
    /// Time until which the instance may be answered.
    pub expires_at_ms: i64,
}

/// Reason why a run is not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawRefusal {
    /// The run was drawn before, with a different nonce.
    OtherNonce,
    /// The entry has no run of this number.
    NoSuchRun,
    /// The entry is finalized, or its epoch is not open.
    Closed,
    /// The round of the beacon that the pool derives from has not come.
    NoPool,
    /// The reservation of the run has ended, and the pool has no room left for it.
    Exhausted,
    /// The reservation of the run has ended, and the owner holds the maximum number of runs, which is given.
    ShareUsedUp(i64),
}

/// Decision on a draw.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DrawDecision {
    /// These leaves are issued, in this order.
    Issue(Vec<DrawnLeaf>),
    /// The same draw was made before; its instances are returned.
    Repeat,
    /// Nothing is issued, for this reason.
    Refuse(DrawRefusal),
}

/// Decides on a draw from stored facts; the use cases own the rule.
pub type DecideDraw = fn(&NewDraw<'_>, &DrawFacts) -> DrawDecision;

/// Outcome of drawing a run.
#[derive(Debug, Clone, PartialEq)]
pub enum Issued {
    /// The instances of the run, with the receipt of the draw.
    Instances(Vec<InstanceRow>, Option<GivenReceipt>),
    /// Nothing was issued, for this reason.
    Refused(DrawRefusal),
}

impl Store {
    /// Issues the instances of an entry's run as `decide` says, or returns the issued ones.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn issue_instances(&self, new: &NewDraw<'_>, decide: DecideDraw, now_ms: i64) -> StoreResult<Issued> {
        let mut tx = self.begin().await?;
        let entry = entry_in(&mut tx, new.entry_id).await?.ok_or_else(|| StoreError::corrupt("entries", "gone"))?;
        tx.lock([Lock::Epoch(&entry.epoch_id)]).await?;
        let before = of_run(&mut tx, new.entry_id, new.run).await?;
        let facts = facts_of(&mut tx, new.entry_id, &before, now_ms).await?;
        let leaves = match decide(new, &facts) {
            DrawDecision::Issue(leaves) => leaves,
            DrawDecision::Repeat => {
                // Others need not wait for the search.
                drop(tx);
                let receipt = match before.first() {
                    Some(first) => self.receipt_of_draw(facts.epoch.id(), &first.id).await?,
                    None => None,
                };
                return Ok(Issued::Instances(before, receipt));
            }
            DrawDecision::Refuse(refusal) => return Ok(Issued::Refused(refusal)),
        };
        let mut prompts_sha256 = Vec::with_capacity(leaves.len());
        for (ordinal, drawn) in (facts.issued_leaves.len() as i64 + 1..).zip(&leaves) {
            let task = insert(&mut tx, new, &facts.epoch.commitment, ordinal, drawn, now_ms).await?;
            prompts_sha256.push(prompts_hash(task.turns.iter().map(|turn| turn.prompt.as_str())));
        }
        let instances = of_run(&mut tx, new.entry_id, new.run).await?;
        let drawn = DrawFact {
            entry: new.entry_id.to_owned(),
            run: new.run,
            nonce: new.nonce.to_owned(),
            proof: new.lot.proof().map(ToOwned::to_owned),
            instances: instances.iter().map(|own| own.id.clone()).collect(),
            prompts_sha256,
            drawn_at_ms: now_ms,
        };
        let receipt = witness(&mut tx, &*self.signer()?, facts.epoch.id(), &Fact::Draw(drawn)).await?;
        commit(tx, "issue_instances").await?;
        Ok(Issued::Instances(instances, Some(receipt)))
    }

    /// Returns the receipt of the draw whose first instance this is, published or not. Within a text of canonical JSON a
    /// quotation mark has a backslash before it, so the pattern matches no other receipt.
    async fn receipt_of_draw(&self, epoch_id: &str, first: &str) -> StoreResult<Option<GivenReceipt>> {
        let found: Option<(String, String, String, String)> = query_as(
            "SELECT body, hash, signature, public_key FROM pending_receipts WHERE epoch_id = $1 AND body LIKE $2
             UNION ALL SELECT body, hash, signature, public_key FROM receipts WHERE epoch_id = $1 AND body LIKE $2",
        )
        .bind(epoch_id)
        .bind(format!("%\"draw\":{{%\"instances\":[\"{first}\"%"))
        .fetch_optional(&self.readers)
        .await?;
        let read = |(body, hash, signature, public_key): (String, String, String, String)| {
            let receipt = serde_json::from_str(&body).map_err(|error| StoreError::corrupt("receipts", error))?;
            Ok(GivenReceipt { receipt, hash, signature, public_key })
        };
        found.map(read).transpose()
    }
}

/// Reads the facts that decide on the draw of a run; `before` holds its issued instances.
async fn facts_of(tx: &mut Tx, entry_id: &str, before: &[InstanceRow], now_ms: i64) -> StoreResult<DrawFacts> {
    let entry = entry_in(tx, entry_id).await?.ok_or_else(|| StoreError::corrupt("entries", "gone"))?;
    let epoch = epoch_in(tx, &entry.epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
    let holdings = holdings_in(tx, epoch.id()).await?;
    let issued: Vec<(u32, bool)> = query_as("SELECT leaf, entry_id = $2 FROM instances WHERE epoch_id = $1")
        .bind(epoch.id())
        .bind(entry_id)
        .fetch_all(tx)
        .await?;
    let own_leaves = issued.iter().filter(|(_, is_own)| *is_own).map(|(leaf, _)| *leaf).collect();
    let issued_leaves = issued.into_iter().map(|(leaf, _)| leaf).collect();
    let earlier_nonce = before.first().map(|first| first.nonce.clone());
    Ok(DrawFacts { entry, epoch, earlier_nonce, holdings, issued_leaves, own_leaves, now_ms })
}

/// Stores an instance and its task, which it returns.
async fn insert<'d>(
    tx: &mut Tx,
    new: &'d NewDraw<'_>,
    commitment: &Commitment,
    ordinal: i64,
    drawn: &DrawnLeaf,
    now_ms: i64,
) -> StoreResult<&'d Task> {
    let Some(specification) = new.specification(commitment, drawn.leaf) else {
        return Err(StoreError::corrupt("secrets", format!("the pool has no leaf {}", drawn.leaf)));
    };
    let hash = put_task(tx, &specification.task).await?;
    let id = uuid::Uuid::new_v4().to_string();
    let salt = hex(&new.secret.key.derive("receipt", &[id.as_bytes()]));
    query(
        "INSERT INTO instances (id, entry_id, epoch_id, ordinal, run, family, family_index, nonce, leaf, task_hash,
                                issued_at_ms, expires_at_ms, salt)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13)",
    )
    .bind(id)
    .bind(new.entry_id)
    .bind(&commitment.epoch)
    .bind(ordinal)
    .bind(i64::from(new.run))
    .bind(&drawn.family)
    .bind(i64::from(drawn.family_index))
    .bind(new.nonce)
    .bind(i64::from(drawn.leaf))
    .bind(hash)
    .bind(now_ms)
    .bind(drawn.expires_at_ms)
    .bind(salt)
    .execute(tx)
    .await?;
    Ok(&specification.task)
}

/// Stores a task under its hash, and returns the hash.
async fn put_task(tx: &mut Tx, task: &Task) -> StoreResult<String> {
    let hash = task.content_hash();
    let body = serde_json::to_string(task).map_err(|error| StoreError::corrupt("tasks", error))?;
    query("INSERT INTO tasks (hash, id, family, body) VALUES ($1, $2, $3, $4) ON CONFLICT (hash) DO NOTHING")
        .bind(&hash)
        .bind(&task.id)
        .bind(task.family())
        .bind(body)
        .execute(tx)
        .await?;
    Ok(hash)
}
