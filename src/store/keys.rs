//! API keys. Only the owner knows the secret of a key; the database holds its hash.

use std::collections::BTreeMap;

use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::db::{Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::{Store, StoreResult, commit};
use plumbline_engine::tasks::hex;

/// Maximum number of live keys of an owner: one in use and one to change over to.
pub const LIVE_KEYS: i64 = 2;
/// Prefix of every key, so that a leaked key is recognizable as one.
const PREFIX: &str = "plk";

/// Scope of a key: what it allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Beginning runs and posting submissions.
    Submit,
    /// Grading within a request.
    Grade,
    /// Reading, which needs no key as long as reading is public.
    Read,
    /// Everything.
    Admin,
}

impl Scope {
    /// All scopes.
    pub const ALL: [Self; 4] = [Self::Submit, Self::Grade, Self::Read, Self::Admin];

    /// Returns the name of the scope.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Submit => "submit",
            Self::Grade => "grade",
            Self::Read => "read",
            Self::Admin => "admin",
        }
    }
}

/// Row of a key.
#[derive(Debug, Clone)]
pub struct KeyRow {
    /// Public part of the key.
    pub id: String,
    /// Owner of the key.
    pub owner: String,
    /// Scopes of the key.
    pub scopes: Vec<Scope>,
    /// Time of creation, in milliseconds since 1970.
    pub created_at_ms: i64,
    /// Time at which the key expires.
    pub expires_at_ms: Option<i64>,
    /// Time at which the key was revoked.
    pub revoked_at_ms: Option<i64>,
    /// Time of the last use, to the minute.
    pub last_used_at_ms: Option<i64>,
    secret_hash: String,
}

impl KeyRow {
    /// Returns whether the key allows what needs this scope.
    #[must_use]
    pub fn allows(&self, scope: Scope) -> bool {
        self.scopes.iter().any(|own| *own == scope || *own == Scope::Admin)
    }

    /// Returns whether the key may be used now.
    #[must_use]
    pub fn is_live(&self, now_ms: i64) -> bool {
        self.revoked_at_ms.is_none() && self.expires_at_ms.is_none_or(|end| now_ms < end)
    }

    /// Returns whether this is the secret of the key.
    #[must_use]
    pub fn has_secret(&self, secret: &str) -> bool {
        self.secret_hash == hash(secret)
    }
}

/// Splits a key, as its owner sends it, into public part and secret; none if it does not have the form of a key.
#[must_use]
pub fn parts(key: &str) -> Option<(&str, &str)> {
    key.strip_prefix(PREFIX)?.strip_prefix('_')?.split_once('_')
}

fn hash(secret: &str) -> String {
    hex(&Sha256::digest(secret))
}

type Columns = (String, String, String, String, i64, Option<i64>, Option<i64>, Option<i64>);

fn read((id, owner, secret_hash, scopes, created_at_ms, expires_at_ms, revoked_at_ms, last): Columns) -> KeyRow {
    let has = |scope: &Scope| scopes.split(',').any(|name| name == scope.name());
    KeyRow {
        id,
        owner,
        secret_hash,
        scopes: Scope::ALL.into_iter().filter(has).collect(),
        created_at_ms,
        expires_at_ms,
        revoked_at_ms,
        last_used_at_ms: last,
    }
}

macro_rules! select_key {
    ($rest:literal) => {
        concat!(
            "SELECT id, owner, secret_hash, scopes, created_at_ms, expires_at_ms, revoked_at_ms, last_used_at_ms FROM keys ",
            $rest
        )
    };
}

/// Stores a new key, and returns the whole key including its secret.
async fn enter_key(
    tx: &mut Tx,
    owner: &str,
    scopes: &[Scope],
    expires_at_ms: Option<i64>,
    now_ms: i64,
) -> StoreResult<String> {
    let id = Uuid::new_v4().simple().to_string()[..12].to_owned();
    // 244 random bits.
    let secret = format!("{}{}", Uuid::new_v4().simple(), Uuid::new_v4().simple());
    let scopes: Vec<&str> = scopes.iter().map(|scope| scope.name()).collect();
    query(
        "INSERT INTO keys (id, owner, secret_hash, scopes, created_at_ms, expires_at_ms) VALUES ($1, $2, $3, $4, $5, $6)",
    )
    .bind(&id)
    .bind(owner)
    .bind(hash(&secret))
    .bind(scopes.join(","))
    .bind(now_ms)
    .bind(expires_at_ms)
    .execute(tx)
    .await?;
    Ok(format!("{PREFIX}_{id}_{secret}"))
}

impl Store {
    /// Creates a key and returns it with its secret, which is never shown again. Returns none if the owner has
    /// [`LIVE_KEYS`] live keys.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn create_key(
        &self,
        owner: &str,
        scopes: &[Scope],
        expires_at_ms: Option<i64>,
        now_ms: i64,
    ) -> StoreResult<Option<String>> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(owner)]).await?;
        let live: i64 = query_scalar(
            "SELECT COUNT(*) FROM keys
             WHERE owner = $1 AND revoked_at_ms IS NULL AND (expires_at_ms IS NULL OR expires_at_ms > $2)",
        )
        .bind(owner)
        .bind(now_ms)
        .fetch_one(&mut tx)
        .await?;
        if live >= LIVE_KEYS {
            return Ok(None);
        }
        let key = enter_key(&mut tx, owner, scopes, expires_at_ms, now_ms).await?;
        commit(tx, "create_key").await?;
        Ok(Some(key))
    }

    /// Creates a key with the owner and scopes of an old key, which expires at `old_ends_at_ms`. Returns none if there
    /// is no such key, or if the owner has [`LIVE_KEYS`] other live keys.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn rotate_key(
        &self,
        old_id: &str,
        old_ends_at_ms: i64,
        expires_at_ms: Option<i64>,
        now_ms: i64,
    ) -> StoreResult<Option<String>> {
        let Some(old) = self.key(old_id).await? else { return Ok(None) };
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(&old.owner)]).await?;
        let others: i64 = query_scalar(
            "SELECT COUNT(*) FROM keys
             WHERE owner = $1 AND id <> $3 AND revoked_at_ms IS NULL AND (expires_at_ms IS NULL OR expires_at_ms > $2)",
        )
        .bind(&old.owner)
        .bind(now_ms)
        .bind(old_id)
        .fetch_one(&mut tx)
        .await?;
        // During the overlap the owner may have one key more than otherwise.
        if others >= LIVE_KEYS {
            return Ok(None);
        }
        query(
            "UPDATE keys SET expires_at_ms = CASE WHEN expires_at_ms < $2 THEN expires_at_ms ELSE $2 END WHERE id = $1",
        )
        .bind(old_id)
        .bind(old_ends_at_ms)
        .execute(&mut tx)
        .await?;
        let key = enter_key(&mut tx, &old.owner, &old.scopes, expires_at_ms, now_ms).await?;
        commit(tx, "rotate_key").await?;
        Ok(Some(key))
    }

    /// Returns the key with this public part.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn key(&self, id: &str) -> StoreResult<Option<KeyRow>> {
        let row: Option<Columns> =
            query_as(select_key!("WHERE id = $1")).bind(id).fetch_optional(&self.readers).await?;
        Ok(row.map(read))
    }

    /// Returns all keys, oldest first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn keys(&self) -> StoreResult<Vec<KeyRow>> {
        let rows: Vec<Columns> = query_as(select_key!("ORDER BY created_at_ms, id")).fetch_all(&self.readers).await?;
        Ok(rows.into_iter().map(read).collect())
    }

    /// Revokes a key. Returns false if it does not exist or was revoked before.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn revoke_key(&self, id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let found = query("UPDATE keys SET revoked_at_ms = $2 WHERE id = $1 AND revoked_at_ms IS NULL")
            .bind(id)
            .bind(now_ms)
            .execute(&mut tx)
            .await?;
        commit(tx, "revoke_key").await?;
        Ok(found > 0)
    }

    /// Records when keys were last used, given as public part and time, in one transaction.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn note_key_uses(&self, uses: &[(String, i64)]) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        // All nodes take the rows in the same order.
        let uses: BTreeMap<&String, i64> = uses.iter().map(|(id, used_at_ms)| (id, *used_at_ms)).collect();
        for (id, used_at_ms) in uses {
            query("UPDATE keys SET last_used_at_ms = $2 WHERE id = $1 AND COALESCE(last_used_at_ms, 0) < $2")
                .bind(id)
                .bind(used_at_ms)
                .execute(&mut tx)
                .await?;
        }
        commit(tx, "note_key_uses").await
    }
}
