//! Instances: specifications issued to entries, each answered at most once.

use super::db::{Row, Tx, query, query_as, query_scalar};
use super::epochs::epoch_in;
use super::evidence::witness;
use super::locks::Lock;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::evidence::{Fact, TranscriptFact};
use plumbline_engine::tasks::Task;

/// Row of an instance, with its answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InstanceRow {
    /// Identifier of the instance.
    pub id: String,
    /// Identifier of its entry.
    pub entry_id: String,
    /// Identifier of its epoch.
    pub epoch_id: String,
    /// Position in the order of issue, from 1.
    pub ordinal: i64,
    /// Number of the run within the entry, from 1.
    pub run: u32,
    /// Family of the task; secret until the epoch is over.
    pub family: String,
    /// Index among the family's instances in the run.
    pub family_index: u32,
    /// Nonce that the entrant chose for the run.
    pub nonce: String,
    /// Leaf of the specification in the pool; secret until the epoch is over.
    pub leaf: u32,
    /// Hash of its task; secret until the epoch is over.
    pub task_hash: String,
    /// Time of issue, in milliseconds since 1970.
    pub issued_at_ms: i64,
    /// Time until which it may be answered.
    pub expires_at_ms: i64,
    /// SHA-256 of the transcript that the entrant promised to show.
    pub transcript_hash: Option<String>,
    /// Time at which a transcript with that hash was shown.
    pub transcript_checked_ms: Option<i64>,
    /// Identifier of the submission that answered it.
    pub submission_id: Option<String>,
    /// Hash of the log that answered it.
    pub log_hash: Option<String>,
}

macro_rules! select_instance {
    ($rest:literal) => {
        concat!(
            "SELECT i.id, i.entry_id, i.epoch_id, i.ordinal, i.run, i.family, i.family_index, i.nonce, i.leaf, i.task_hash,
                    i.issued_at_ms, i.expires_at_ms, i.transcript_hash, i.transcript_checked_ms, s.id AS submission_id, s.log_hash
             FROM instances i LEFT JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE ",
            $rest
        )
    };
}

fn read(row: &Row) -> StoreResult<InstanceRow> {
    let small = |number: i64| u32::try_from(number).map_err(|error| StoreError::corrupt("instances", error));
    Ok(InstanceRow {
        id: row.get("id")?,
        entry_id: row.get("entry_id")?,
        epoch_id: row.get("epoch_id")?,
        ordinal: row.get("ordinal")?,
        run: small(row.get("run")?)?,
        family: row.get("family")?,
        family_index: small(row.get("family_index")?)?,
        nonce: row.get("nonce")?,
        leaf: small(row.get("leaf")?)?,
        task_hash: row.get("task_hash")?,
        issued_at_ms: row.get("issued_at_ms")?,
        expires_at_ms: row.get("expires_at_ms")?,
        transcript_hash: row.get("transcript_hash")?,
        transcript_checked_ms: row.get("transcript_checked_ms")?,
        submission_id: row.get("submission_id")?,
        log_hash: row.get("log_hash")?,
    })
}

/// Reads an instance within the transaction.
pub(super) async fn instance_in(tx: &mut Tx, id: &str) -> StoreResult<InstanceRow> {
    read(&query(select_instance!("WHERE i.id = $1")).bind(id).fetch_one(tx).await?)
}

/// Reads the instances of a run within the transaction, in order of issue.
pub(super) async fn of_run(tx: &mut Tx, entry_id: &str, run: u32) -> StoreResult<Vec<InstanceRow>> {
    let rows = query(select_instance!("WHERE i.entry_id = $1 AND i.run = $2 ORDER BY i.ordinal"))
        .bind(entry_id)
        .bind(i64::from(run))
        .fetch_all(tx)
        .await?;
    rows.iter().map(read).collect()
}

impl Store {
    /// Returns the instance with this identifier.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn instance(&self, id: &str) -> StoreResult<Option<InstanceRow>> {
        let row = query(select_instance!("WHERE i.id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read).transpose()
    }

    /// Returns the instances of an entry, in order of issue.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn instances_of_entry(&self, entry_id: &str) -> StoreResult<Vec<InstanceRow>> {
        let rows = query(select_instance!("WHERE i.entry_id = $1 ORDER BY i.ordinal"))
            .bind(entry_id)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(read).collect()
    }

    /// Returns all instances of an epoch, in order of issue.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn instances_of_epoch(&self, epoch_id: &str) -> StoreResult<Vec<InstanceRow>> {
        let rows = query(select_instance!("WHERE i.epoch_id = $1 ORDER BY i.ordinal"))
            .bind(epoch_id)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(read).collect()
    }

    /// Returns the task with this hash, of any suite.
    ///
    /// # Errors
    /// Returns an error if the database fails, or if the task does not exist or cannot be read.
    pub async fn task(&self, hash: &str) -> StoreResult<Task> {
        let body: String =
            query_scalar("SELECT body FROM tasks WHERE hash = $1").bind(hash).fetch_one(&self.readers).await?;
        serde_json::from_str(&body).map_err(|error| StoreError::corrupt("tasks", error))
    }

    /// Records that the promised transcript was shown. Returns false if the epoch is over, because a reveal must not
    /// change.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn note_transcript(&self, instance_id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let epoch_id = instance_in(&mut tx, instance_id).await?.epoch_id;
        tx.lock([Lock::Epoch(&epoch_id)]).await?;
        let instance = instance_in(&mut tx, instance_id).await?;
        let epoch = epoch_in(&mut tx, &instance.epoch_id).await?;
        if epoch.is_none_or(|epoch| epoch.is_over(now_ms)) {
            return Ok(false);
        }
        let Some(transcript_sha256) = instance.transcript_hash.filter(|_| instance.transcript_checked_ms.is_none())
        else {
            return Ok(true);
        };
        query("UPDATE instances SET transcript_checked_ms = $2 WHERE id = $1")
            .bind(instance_id)
            .bind(now_ms)
            .execute(&mut tx)
            .await?;
        let shown = TranscriptFact { instance: instance.id, transcript_sha256, checked_at_ms: now_ms };
        witness(&mut tx, &*self.signer()?, &instance.epoch_id, &Fact::Transcript(shown)).await?;
        commit(tx, "note_transcript").await?;
        Ok(true)
    }

    /// Returns at most `limit` answers of an epoch after position `after` in the order of issue: position, instance,
    /// and log as canonical JSON.
    ///
    /// # Errors
    /// Returns an error if the database fails or a log cannot be read.
    pub async fn answers(&self, epoch_id: &str, after: i64, limit: i64) -> StoreResult<Vec<(i64, String, Vec<u8>)>> {
        let rows: Vec<(i64, String, Vec<u8>)> = query_as(
            "SELECT i.ordinal, i.id, s.log FROM instances i JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE
             WHERE i.epoch_id = $1 AND i.ordinal > $2 ORDER BY i.ordinal LIMIT $3",
        )
        .bind(epoch_id)
        .bind(after)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let mut answers = Vec::with_capacity(rows.len());
        for (ordinal, id, log) in rows {
            answers.push((ordinal, id, self.blobs.unpack(&self.readers, "submissions", log).await?));
        }
        Ok(answers)
    }

    /// Counts the issued and answered instances of an epoch, and its entries in each tier. `specifications` is the size
    /// of its pool: leaves from there on are siblings.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn epoch_counts(&self, epoch_id: &str, specifications: u32) -> StoreResult<EpochCounts> {
        let (issued, answered, siblings, siblings_answered, dev, official) = query_as(
            "SELECT COUNT(*) FILTER (WHERE i.leaf < $2), COUNT(s.id) FILTER (WHERE i.leaf < $2),
                    COUNT(*) FILTER (WHERE i.leaf >= $2), COUNT(s.id) FILTER (WHERE i.leaf >= $2),
                    (SELECT COUNT(*) FROM entries WHERE epoch_id = $1 AND tier = 'dev'),
                    (SELECT COUNT(*) FROM entries WHERE epoch_id = $1 AND tier = 'official')
             FROM instances i LEFT JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE
             WHERE i.epoch_id = $1",
        )
        .bind(epoch_id)
        .bind(i64::from(specifications))
        .fetch_one(&self.readers)
        .await?;
        Ok(EpochCounts { issued, answered, siblings, siblings_answered, dev, official })
    }
}

/// Counts of an epoch so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpochCounts {
    /// Number of issued instances, without siblings.
    pub issued: i64,
    /// Number of answered instances, without siblings.
    pub answered: i64,
    /// Number of issued siblings.
    pub siblings: i64,
    /// Number of answered siblings.
    pub siblings_answered: i64,
    /// Number of entries in the dev tier.
    pub dev: i64,
    /// Number of entries in the official tier.
    pub official: i64,
}
