//! API keys. Only the owner knows the secret of a key; the database holds its hash.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::db::{FromRow, Row, Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::{Store, StoreResult, commit};
use plumbline_engine::tasks::hex;

/// Maximum number of live keys of an owner, or of a member: one in use and one to change over to.
pub const LIVE_KEYS: i64 = 2;
/// Prefix of every key, so that a leaked key is recognizable as one.
const PREFIX: &str = "plk";

/// Scope of a key: what it allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[schema(as = KeyScope)]
#[serde(rename_all = "snake_case")]
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

/// Role of a member: what its keys may do at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Grades within requests, and reads.
    Reader,
    /// Also begins runs and posts submissions.
    Submitter,
    /// Also manages members, keys and webhooks, withdraws runs and lifts embargoes.
    Manager,
}

impl Role {
    /// All roles.
    pub const ALL: [Self; 3] = [Self::Reader, Self::Submitter, Self::Manager];

    /// Returns the name of the role.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Reader => "reader",
            Self::Submitter => "submitter",
            Self::Manager => "manager",
        }
    }

    /// Finds the role with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }

    /// Returns whether a key of a member with this role may have the scope.
    #[must_use]
    pub const fn allows(self, scope: Scope) -> bool {
        match scope {
            Scope::Grade | Scope::Read => true,
            Scope::Submit => !matches!(self, Self::Reader),
            Scope::Admin => false,
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
    /// Member of the owner to whom the key belongs; none if it belongs to the owner itself.
    pub member: Option<String>,
    /// Role of that member; none also if the member was removed.
    pub role: Option<Role>,
    /// Scopes of the key.
    pub scopes: Vec<Scope>,
    /// Time of creation, in milliseconds since 1970.
    pub created_at_ms: i64,
    /// Time at which the key expires.
    pub expires_at_ms: Option<i64>,
    /// Time for which the key was made, in milliseconds, 0 if it was made to live for ever; its end comes sooner if it was
    /// replaced. None if a former version made it.
    pub lifetime_ms: Option<i64>,
    /// Time at which the key was revoked.
    pub revoked_at_ms: Option<i64>,
    /// Time of the last use, to the minute.
    pub last_used_at_ms: Option<i64>,
    secret_hash: String,
}

impl KeyRow {
    /// Returns whether another key replaced this one: it ends sooner than it was made to.
    #[must_use]
    pub fn is_replaced(&self) -> bool {
        self.expires_at_ms
            .zip(self.lifetime_ms)
            .is_some_and(|(end, lifetime_ms)| lifetime_ms == 0 || end < self.created_at_ms.saturating_add(lifetime_ms))
    }

    /// Returns whether the key allows what needs this scope.
    #[must_use]
    pub fn allows(&self, scope: Scope) -> bool {
        let has_scope = self.scopes.iter().any(|own| *own == scope || *own == Scope::Admin);
        has_scope && self.role.is_none_or(|role| role.allows(scope))
    }

    /// Returns whether the key may manage what belongs to its owner: members, keys, webhooks.
    #[must_use]
    pub fn manages(&self) -> bool {
        self.allows(Scope::Submit) && self.role.is_none_or(|role| role == Role::Manager)
    }

    /// Returns whether the key may be used now.
    #[must_use]
    pub fn is_live(&self, now_ms: i64) -> bool {
        let has_member = self.member.is_none() || self.role.is_some();
        has_member && self.revoked_at_ms.is_none() && self.expires_at_ms.is_none_or(|end| now_ms < end)
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

/// Returns whether a text begins as the keys of this service do.
#[must_use]
pub fn has_form(key: &str) -> bool {
    key.strip_prefix(PREFIX).is_some_and(|rest| rest.starts_with('_'))
}

fn hash(secret: &str) -> String {
    hex(&Sha256::digest(secret))
}

impl FromRow for KeyRow {
    fn from_row(row: &Row) -> StoreResult<Self> {
        let scopes: &str = row.get("scopes")?;
        let has = |scope: &Scope| scopes.split(',').any(|name| name == scope.name());
        Ok(Self {
            id: row.get("id")?,
            owner: row.get("owner")?,
            member: row.get("member")?,
            role: row.get::<Option<&str>>("role")?.and_then(Role::named),
            secret_hash: row.get("secret_hash")?,
            scopes: Scope::ALL.into_iter().filter(has).collect(),
            created_at_ms: row.get("created_at_ms")?,
            expires_at_ms: row.get("expires_at_ms")?,
            lifetime_ms: row.get("lifetime_ms")?,
            revoked_at_ms: row.get("revoked_at_ms")?,
            last_used_at_ms: row.get("last_used_at_ms")?,
        })
    }
}

macro_rules! select_key {
    ($rest:literal) => {
        concat!(
            "SELECT k.id, k.owner, k.member, m.role, k.secret_hash, k.scopes, k.created_at_ms, k.expires_at_ms,
                    k.revoked_at_ms, k.last_used_at_ms, k.lifetime_ms
             FROM keys k LEFT JOIN members m ON m.owner = k.owner AND m.name = k.member ",
            $rest
        )
    };
}

/// Owner of a key, and the member to whom it belongs.
#[derive(Debug, Clone, Copy)]
pub struct Holder<'a> {
    /// Owner of the key.
    pub owner: &'a str,
    /// Member of the owner; none if the key belongs to the owner itself.
    pub member: Option<&'a str>,
}

/// Outcome of creating a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum KeyCreated {
    /// The whole key with its secret, which is never shown again.
    Key(String),
    /// Its holder has [`LIVE_KEYS`] live keys.
    TooMany,
    /// The owner has no such member.
    NoMember,
}

/// Stores a new key, and returns the whole key including its secret.
async fn enter_key(
    tx: &mut Tx,
    holder: Holder<'_>,
    scopes: &[Scope],
    expires_at_ms: Option<i64>,
    now_ms: i64,
) -> StoreResult<String> {
    let id = Uuid::new_v4().simple().to_string()[..12].to_owned();
    // 244 random bits.
    let secret = format!("{}{}", Uuid::new_v4().simple(), Uuid::new_v4().simple());
    let scopes: Vec<&str> = scopes.iter().map(|scope| scope.name()).collect();
    query(
        "INSERT INTO keys (id, owner, member, secret_hash, scopes, created_at_ms, expires_at_ms, lifetime_ms)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8)",
    )
    .bind(&id)
    .bind(holder.owner)
    .bind(holder.member)
    .bind(hash(&secret))
    .bind(scopes.join(","))
    .bind(now_ms)
    .bind(expires_at_ms)
    .bind(expires_at_ms.map_or(0, |expires_at_ms| expires_at_ms - now_ms))
    .execute(tx)
    .await?;
    Ok(format!("{PREFIX}_{id}_{secret}"))
}

impl Store {
    /// Creates a key, unless its holder has [`LIVE_KEYS`] live keys or is no member of the owner any more.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn create_key(
        &self,
        holder: Holder<'_>,
        scopes: &[Scope],
        expires_at_ms: Option<i64>,
        now_ms: i64,
    ) -> StoreResult<KeyCreated> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(holder.owner)]).await?;
        if let Some(member) = holder.member {
            let is_member: bool = query_scalar("SELECT EXISTS (SELECT 1 FROM members WHERE owner = $1 AND name = $2)")
                .bind(holder.owner)
                .bind(member)
                .fetch_one(&mut tx)
                .await?;
            if !is_member {
                return Ok(KeyCreated::NoMember);
            }
        }
        let live: i64 = query_scalar(
            "SELECT COUNT(*) FROM keys
             WHERE owner = $1 AND COALESCE(member, '') = $3 AND revoked_at_ms IS NULL
               AND (expires_at_ms IS NULL OR expires_at_ms > $2)",
        )
        .bind(holder.owner)
        .bind(now_ms)
        .bind(holder.member.unwrap_or_default())
        .fetch_one(&mut tx)
        .await?;
        if live >= LIVE_KEYS {
            return Ok(KeyCreated::TooMany);
        }
        let key = enter_key(&mut tx, holder, scopes, expires_at_ms, now_ms).await?;
        commit(tx, "create_key").await?;
        Ok(KeyCreated::Key(key))
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
             WHERE owner = $1 AND COALESCE(member, '') = $4 AND id <> $3 AND revoked_at_ms IS NULL
               AND (expires_at_ms IS NULL OR expires_at_ms > $2)",
        )
        .bind(&old.owner)
        .bind(now_ms)
        .bind(old_id)
        .bind(old.member.as_deref().unwrap_or_default())
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
        let holder = Holder { owner: &old.owner, member: old.member.as_deref() };
        let key = enter_key(&mut tx, holder, &old.scopes, expires_at_ms, now_ms).await?;
        commit(tx, "rotate_key").await?;
        Ok(Some(key))
    }

    /// Returns the key with this public part.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn key(&self, id: &str) -> StoreResult<Option<KeyRow>> {
        query_as(select_key!("WHERE k.id = $1")).bind(id).fetch_optional(&self.readers).await
    }

    /// Returns the keys of an owner and of its members, oldest first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn keys_of(&self, owner: &str) -> StoreResult<Vec<KeyRow>> {
        query_as(select_key!("WHERE k.owner = $1 ORDER BY k.created_at_ms, k.id"))
            .bind(owner)
            .fetch_all(&self.readers)
            .await
    }

    /// Returns all keys, oldest first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn keys(&self) -> StoreResult<Vec<KeyRow>> {
        query_as(select_key!("ORDER BY k.created_at_ms, k.id")).fetch_all(&self.readers).await
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
