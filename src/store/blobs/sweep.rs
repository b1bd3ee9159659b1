//! Deletes objects that no row refers to: those of transactions that failed, and of discarded regrades.
//!
//! A copy of a database knows the same place, but not the rows that the original writes after the copy was made. So a
//! place holds a token that each sweep replaces, and the database notes it. A copy knows the token only until the next
//! sweep of the original, a day later, and what is younger than two days is never deleted. A database that swept lately and
//! finds a token of another contests the place: it puts a token that nobody knows, and an operator decides.

use std::collections::HashSet;

use futures_util::TryStreamExt as _;
use object_store::{ObjectStoreExt as _, path::Path};

use super::reference::{COLUMNS, LENGTH};
use super::{Opened, Reference};
use crate::clock::{DAY_MS, rfc3339};
use crate::store::db::{Builder, query, query_scalar};
use crate::store::{Store, StoreError, StoreResult, commit};

/// Number of objects that are looked up at once.
const AT_ONCE: usize = 500;
/// Days after which an object that no row refers to is an orphan. A row is written within a minute of its object; the
/// rest allows for clocks that differ between nodes.
const DAYS: i64 = 2;
/// Object that holds the token of the last sweep.
const TOKEN: &str = "plumbline.sweep";
/// Number of tokens that a database remembers to have written.
const MAX_TOKENS: usize = 8;

/// What a sweep came to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Swept {
    /// Number of objects that were deleted.
    Deleted(usize),
    /// Another database sweeps the place, so nothing was deleted.
    OfAnother {
        /// The place.
        place: String,
        /// Object that says whose the place is. Without it, the next database that sweeps takes the place.
        token: &'static str,
    },
}

/// What a database finds of the token of its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Token {
    /// The token is its own.
    Own,
    /// There was none. A copy may take the place first, so nothing is deleted before the next sweep.
    First,
    /// Another database wrote it.
    OfAnother,
}

impl Store {
    /// Returns whether there are blobs, and they were last swept a day ago.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn is_sweep_due(&self, now_ms: i64) -> StoreResult<bool> {
        const SWEPT: &str = "SELECT value FROM agreed WHERE name = 'blobs swept'";
        if self.blobs.opened().is_none() {
            return Ok(false);
        }
        let swept: Option<String> = query_scalar(SWEPT).fetch_optional(&self.readers).await?;
        let swept_ms = swept.and_then(|swept| swept.parse::<i64>().ok());
        Ok(!swept_ms.is_some_and(|swept_ms| (swept_ms..swept_ms + DAY_MS).contains(&now_ms)))
    }

    /// Deletes objects that are older than two days and to which no row refers. If two nodes do it at the same time, both do
    /// the same.
    ///
    /// # Errors
    /// Returns an error if the place or the database fails; then the rest is left for the next time.
    pub async fn sweep_blobs(&self, now_ms: i64) -> StoreResult<Swept> {
        let Some(opened) = self.blobs.opened() else { return Ok(Swept::Deleted(0)) };
        let token = self.take_token(&opened, now_ms).await?;
        if token != Token::Own {
            self.note("blobs swept", &now_ms.to_string()).await?;
            let place = opened.place.to_string();
            let is_first = token == Token::First;
            return Ok(if is_first { Swept::Deleted(0) } else { Swept::OfAnother { place, token: TOKEN } });
        }
        let before = rfc3339(now_ms - DAYS * DAY_MS);
        let mut deleted = 0;
        let mut objects = opened.objects()?.list(None).try_chunks(AT_ONCE);
        loop {
            let chunk = objects.try_next().await.map_err(|error| opened.failed(&"".into(), &error.1))?;
            let Some(chunk) = chunk else { break };
            let old = chunk.iter().filter_map(|object| Reference::at(&object.location));
            let old: Vec<Reference> = old.filter(|reference| reference.day() < &before[..10]).collect();
            deleted += self.delete_orphans(&opened, old).await?;
        }
        self.note("blobs swept", &now_ms.to_string()).await?;
        Ok(Swept::Deleted(deleted))
    }

    /// Replaces the token of the place by a new one, unless this database did not write it.
    ///
    /// The database notes the tokens before the place gets the new one, so neither a process that dies in between nor two
    /// nodes that sweep at the same time lock it out.
    async fn take_token(&self, opened: &Opened, now_ms: i64) -> StoreResult<Token> {
        // When this database last had the token, which is not when it last looked.
        const OWNED: &str = "blobs owned";
        const NOTED: &str = "blobs sweep";
        let path = Path::from(TOKEN);
        let found = match opened.get(&path).await {
            Ok(token) => Some(String::from_utf8_lossy(&token).into_owned()),
            Err(StoreError::BlobLost(_)) => None,
            Err(error) => return Err(error),
        };
        let noted = self.noted_as(NOTED).await?.unwrap_or_default();
        let mut tokens: Vec<&str> = noted.split(' ').filter(|token| !token.is_empty()).collect();
        if let Some(found) = &found
            && !tokens.contains(&found.as_str())
        {
            let owned_ms = self.noted_as(OWNED).await?.and_then(|owned| owned.parse::<i64>().ok());
            if owned_ms.is_some_and(|owned_ms| now_ms - owned_ms < DAYS * DAY_MS) {
                opened.put(&path, uuid::Uuid::new_v4().to_string().into_bytes()).await?;
            }
            return Ok(Token::OfAnother);
        }
        let next = uuid::Uuid::new_v4().to_string();
        tokens.push(&next);
        let kept = &tokens[tokens.len().saturating_sub(MAX_TOKENS)..];
        self.note(NOTED, &kept.join(" ")).await?;
        opened.put(&path, next.clone().into_bytes()).await?;
        self.note(OWNED, &now_ms.to_string()).await?;
        Ok(if found.is_some() { Token::Own } else { Token::First })
    }

    /// Returns a fact that the nodes of the database go by.
    pub(super) async fn noted_as(&self, name: &str) -> StoreResult<Option<String>> {
        query_scalar("SELECT value FROM agreed WHERE name = $1").bind(name).fetch_optional(&self.readers).await
    }

    /// Notes something that all nodes of the database go by.
    pub(super) async fn note(&self, name: &str, value: &str) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query(
            "INSERT INTO agreed (name, value) VALUES ($1, $2)
             ON CONFLICT (name) DO UPDATE SET value = excluded.value",
        )
        .bind(name)
        .bind(value)
        .execute(&mut tx)
        .await?;
        commit(tx, "note").await
    }

    /// Deletes those objects to which no row refers.
    async fn delete_orphans(&self, opened: &Opened, old: Vec<Reference>) -> StoreResult<usize> {
        if old.is_empty() {
            return Ok(0);
        }
        let mut select = Builder::new("");
        for (i, (table, column)) in COLUMNS.into_iter().enumerate() {
            // The index of references has this condition.
            select.push(if i == 0 { "" } else { " UNION ALL " });
            select.push("SELECT ").push(column).push(" FROM ").push(table);
            select
                .push(" WHERE length(")
                .push(column)
                .push(") = ")
                .push(LENGTH)
                .push(" AND ")
                .push(column)
                .push(" IN ");
            select.push_list(old.iter().map(Reference::to_column));
        }
        let held: Vec<(Vec<u8>,)> = select.build_as().fetch_all(&self.readers).await?;
        let held: HashSet<Vec<u8>> = held.into_iter().map(|(column,)| column).collect();
        let mut deleted = 0;
        for orphan in old.iter().filter(|reference| !held.contains(&reference.to_column())) {
            let path = orphan.path();
            match opened.objects()?.delete(&path).await {
                Ok(()) => deleted += 1,
                Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => return Err(opened.failed(&path, &error)),
            }
        }
        Ok(deleted)
    }
}
