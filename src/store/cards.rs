//! Cards of runs and entries. An edit adds a version.

use std::collections::HashMap;

use serde_json::Value;

use super::db::{Builder, Each, Row, Tx, query, query_as};
use super::locks::Lock;
use super::{Store, StoreError, StoreResult, commit};

/// What a card is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CardOf<'a> {
    /// The run with this identifier.
    Run(&'a str),
    /// The entry with this identifier.
    Entry(&'a str),
}

impl<'a> CardOf<'a> {
    const fn ids(self) -> (Option<&'a str>, Option<&'a str>) {
        match self {
            Self::Run(id) => (Some(id), None),
            Self::Entry(id) => (None, Some(id)),
        }
    }
}

/// Card to store.
#[derive(Debug, Clone, Copy)]
pub struct NewCard<'a> {
    /// Identifier of the version.
    pub id: &'a str,
    /// The card as JSON, without the text of the system prompt.
    pub card: &'a Value,
    /// Text of the system prompt.
    pub system_prompt: Option<&'a str>,
    /// Owner of the key that it was sent with.
    pub actor: Option<&'a str>,
}

/// Version of a card.
#[derive(Debug, Clone, PartialEq)]
pub struct CardRow {
    /// Number of the version, from 1.
    pub version: i64,
    /// The card, without the text of the system prompt.
    pub card: Value,
    /// Text of the system prompt.
    pub system_prompt: Option<String>,
    /// Owner of the key that it was sent with.
    pub actor: Option<String>,
    /// Time of the edit, in milliseconds since 1970.
    pub created_at_ms: i64,
}

/// Adds a version of a card within the transaction, which holds the lock of the card unless its run is new. A card that
/// is as it was adds none. Returns the number of the version, or `None` if there are `most` versions already.
pub(super) async fn add(
    tx: &mut Tx,
    of: CardOf<'_>,
    new: &NewCard<'_>,
    most: i64,
    now_ms: i64,
) -> StoreResult<Option<i64>> {
    let (run_id, entry_id) = of.ids();
    let select = "SELECT version, card, system_prompt, actor, created_at_ms FROM cards
                  WHERE run_id = $1 OR entry_id = $2 ORDER BY version DESC LIMIT 1";
    let last = query(select).bind(run_id).bind(entry_id).fetch_optional(&mut *tx).await?;
    let last = last.as_ref().map(read_card).transpose()?;
    let version = last.as_ref().map_or(0, |last| last.version);
    if last.is_some_and(|last| last.card == *new.card && last.system_prompt.as_deref() == new.system_prompt) {
        return Ok(Some(version));
    }
    if version >= most {
        return Ok(None);
    }
    query(
        "INSERT INTO cards (id, run_id, entry_id, version, card, system_prompt, actor, created_at_ms)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8)",
    )
    .bind(new.id)
    .bind(run_id)
    .bind(entry_id)
    .bind(version + 1)
    .bind(new.card.to_string())
    .bind(new.system_prompt)
    .bind(new.actor)
    .bind(now_ms)
    .execute(&mut *tx)
    .await?;
    Ok(Some(version + 1))
}

fn read_card(row: &Row) -> StoreResult<CardRow> {
    let corrupt = |error: serde_json::Error| StoreError::corrupt("cards", error);
    Ok(CardRow {
        version: row.get("version")?,
        card: serde_json::from_str(row.get("card")?).map_err(corrupt)?,
        system_prompt: row.get("system_prompt")?,
        actor: row.get("actor")?,
        created_at_ms: row.get("created_at_ms")?,
    })
}

impl Store {
    /// Adds a version of a card. Returns its number, or `None` if there are `most` versions already.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn add_card(
        &self,
        of: CardOf<'_>,
        new: &NewCard<'_>,
        most: i64,
        now_ms: i64,
    ) -> StoreResult<Option<i64>> {
        let mut tx = self.begin().await?;
        let (CardOf::Run(id) | CardOf::Entry(id)) = of;
        tx.lock([Lock::Card(id)]).await?;
        let version = add(&mut tx, of, new, most, now_ms).await?;
        commit(tx, "add_card").await?;
        Ok(version)
    }

    /// Returns the configuration that the latest card of each run of a suite declares, if it does. Runs under embargo
    /// are left out.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn configurations(&self, suite_id: &str) -> StoreResult<HashMap<String, String>> {
        let declared: Vec<(String, String)> = query_as(Each {
            sqlite: "SELECT c.run_id, json_extract(c.card, '$.configuration_sha256')
                     FROM runs r JOIN cards c ON c.run_id = r.id
                     WHERE r.suite_id = $1 AND c.version = (SELECT MAX(l.version) FROM cards l WHERE l.run_id = r.id)
                       AND NOT EXISTS (SELECT 1 FROM embargoes e WHERE e.run_id = r.id AND e.lifted_at_ms IS NULL)
                       AND json_extract(c.card, '$.configuration_sha256') IS NOT NULL",
            postgres: "SELECT c.run_id, CAST(c.card AS jsonb) ->> 'configuration_sha256'
                       FROM runs r JOIN cards c ON c.run_id = r.id
                       WHERE r.suite_id = $1 AND c.version = (SELECT MAX(l.version) FROM cards l WHERE l.run_id = r.id)
                         AND NOT EXISTS (SELECT 1 FROM embargoes e WHERE e.run_id = r.id AND e.lifted_at_ms IS NULL)
                         AND CAST(c.card AS jsonb) ->> 'configuration_sha256' IS NOT NULL",
        })
        .bind(suite_id)
        .fetch_all(&self.readers)
        .await?;
        Ok(declared.into_iter().collect())
    }

    /// Returns the latest card of each of these runs, without the text of its system prompt. Runs without a card, and
    /// those under embargo, are left out.
    ///
    /// # Errors
    /// Returns an error if the database fails or a card cannot be read.
    pub async fn latest_cards(&self, runs: &[&str]) -> StoreResult<HashMap<String, Value>> {
        if runs.is_empty() {
            return Ok(HashMap::new());
        }
        let mut select = Builder::new(
            "SELECT c.run_id, c.card FROM cards c
             WHERE c.version = (SELECT MAX(l.version) FROM cards l WHERE l.run_id = c.run_id)
               AND NOT EXISTS (SELECT 1 FROM embargoes e WHERE e.run_id = c.run_id AND e.lifted_at_ms IS NULL)
               AND c.run_id IN ",
        );
        select.push_list(runs.iter().copied());
        let found: Vec<(String, String)> = select.build_as().fetch_all(&self.readers).await?;
        let read = |(run, card): (String, String)| {
            Ok((run, serde_json::from_str(&card).map_err(|error| StoreError::corrupt("cards", error))?))
        };
        found.into_iter().map(read).collect()
    }

    /// Returns all versions of a card, latest first.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn cards(&self, of: CardOf<'_>) -> StoreResult<Vec<CardRow>> {
        let (run_id, entry_id) = of.ids();
        let select = "SELECT version, card, system_prompt, actor, created_at_ms FROM cards
                      WHERE run_id = $1 OR entry_id = $2 ORDER BY version DESC";
        let rows = query(select).bind(run_id).bind(entry_id).fetch_all(&self.readers).await?;
        rows.iter().map(read_card).collect()
    }
}
