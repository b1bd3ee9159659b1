//! Embargoes: until a date that is public from the beginning of a run, the run shows an alias instead of its agent, and
//! neither owner, card nor metadata.
//!
//! The row of the run holds the alias, so that nothing that reads runs can reveal the agent. Lifting an embargo writes
//! the agent into the row, and enters the public action `reveal`, by which boards learn of it.

use super::board_actions::enter_action;
use super::db::{Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::postgres::notices::Notice;
use super::{Store, StoreResult, commit};

/// Embargo to store with a new run.
#[derive(Debug, Clone, Copy)]
pub struct NewEmbargo<'a> {
    /// Name that the run shows for its agent.
    pub alias: &'a str,
    /// End of the embargo, in milliseconds since 1970.
    pub until_ms: i64,
}

/// Embargo that holds for a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Embargo {
    /// Name of the agent.
    pub agent: String,
    /// Metadata that the owner provided, as JSON.
    pub metadata: serde_json::Value,
    /// End of the embargo, in milliseconds since 1970.
    pub until_ms: i64,
}

/// Embargo that is over but not lifted yet.
type Due = (String, String, String, i64);

/// Stores the embargo of a run that the same transaction created.
pub(super) async fn enter_embargo(
    tx: &mut Tx,
    run_id: &str,
    agent: &str,
    metadata: &str,
    embargo: &NewEmbargo<'_>,
) -> StoreResult<()> {
    query("INSERT INTO embargoes (run_id, alias, agent, metadata, until_ms) VALUES ($1, $2, $3, $4, $5)")
        .bind(run_id)
        .bind(embargo.alias)
        .bind(agent)
        .bind(metadata)
        .bind(embargo.until_ms)
        .execute(tx)
        .await?;
    Ok(())
}

impl Store {
    /// Returns whether a run of another owner shows this name for its agent.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn is_agent_of_others(&self, name: &str, owner: &str) -> StoreResult<bool> {
        query_scalar("SELECT EXISTS (SELECT 1 FROM runs WHERE agent = $1 AND COALESCE(owner, '') <> $2)")
            .bind(name)
            .bind(owner)
            .fetch_one(&self.readers)
            .await
    }

    /// Returns whether a run of another owner is under embargo with this alias.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn is_alias_of_others(&self, name: &str, owner: &str) -> StoreResult<bool> {
        query_scalar(
            "SELECT EXISTS (SELECT 1 FROM embargoes e JOIN runs r ON r.id = e.run_id
                            WHERE e.alias = $1 AND e.lifted_at_ms IS NULL AND COALESCE(r.owner, '') <> $2)",
        )
        .bind(name)
        .bind(owner)
        .fetch_one(&self.readers)
        .await
    }

    /// Lifts the embargoes that are over. Returns their number.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn lift_embargoes(&self, now_ms: i64) -> StoreResult<usize> {
        let due: Vec<String> =
            query_scalar("SELECT run_id FROM embargoes WHERE lifted_at_ms IS NULL AND until_ms <= $1 ORDER BY run_id")
                .bind(now_ms)
                .fetch_all(&self.readers)
                .await?;
        let mut lifted = 0;
        for run_id in due {
            // One that fails does not keep the others.
            match self.lift_embargo(&run_id, "the service", now_ms).await {
                Ok(done) => lifted += usize::from(done),
                Err(error) => tracing::warn!(run_id, %error, "could not lift an embargo that is over"),
            }
        }
        Ok(lifted)
    }

    /// Lifts the embargo of a run, whether or not it is over. Returns false if none holds.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn lift_embargo(&self, run_id: &str, actor: &str, now_ms: i64) -> StoreResult<bool> {
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        // A regrade takes the order, and then the rows of runs.
        tx.lock([Lock::Run(run_id), Lock::Order]).await?;
        let due: Option<Due> = query_as(
            "UPDATE embargoes SET lifted_at_ms = $2 WHERE run_id = $1 AND lifted_at_ms IS NULL
             RETURNING alias, agent, metadata, until_ms",
        )
        .bind(run_id)
        .bind(now_ms)
        .fetch_optional(&mut tx)
        .await?;
        let Some((alias, agent, metadata, until_ms)) = due else { return Ok(false) };
        query("UPDATE runs SET agent = $2, metadata = $3 WHERE id = $1")
            .bind(run_id)
            .bind(&agent)
            .bind(&metadata)
            .execute(&mut tx)
            .await?;
        let when = if now_ms < until_ms { "its embargo was lifted early" } else { "its embargo ended" };
        let reason = format!("{when}; the run was shown as {alias:?}");
        enter_action(&mut tx, &signer, run_id, "reveal", actor, &reason, now_ms).await?;
        tx.notify(Notice::Ended { changes_board: true }).await?;
        commit(tx, "lift_embargo").await?;
        self.note_ends(true);
        Ok(true)
    }
}
