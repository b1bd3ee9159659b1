//! API keys. The secret of a key is known to its owner alone; its hash is kept.

use sha2::{Digest as _, Sha256};
use sqlx::SqliteConnection;
use uuid::Uuid;

use super::{Store, StoreResult, commit};
use plumbline_engine::tasks::hex;

/// Live keys that an owner may have: one in use and one to change over to.
pub const LIVE_KEYS: i64 = 2;
/// How often the last use of a key is written at most.
/// What every key begins with, so that it is known for one wherever it turns up.
const PREFIX: &str = "plk";

/// What a key allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Begin runs and post submissions.
    Submit,
    /// Grade within the request.
    Grade,
    /// Read; everybody may, as long as reading is public.
    Read,
    /// Everything.
    Admin,
}

impl Scope {
    /// All scopes.
    pub const ALL: [Self; 4] = [Self::Submit, Self::Grade, Self::Read, Self::Admin];

    /// Its name.
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

/// A key as it is kept.
#[derive(Debug, Clone)]
pub struct KeyRow {
    /// Its public part.
    pub id: String,
    /// Who uses it.
    pub owner: String,
    /// What it allows.
    pub scopes: Vec<Scope>,
    /// When it was made.
    pub created_at_ms: i64,
    /// When it ends.
    pub expires_at_ms: Option<i64>,
    /// When it was revoked.
    pub revoked_at_ms: Option<i64>,
    /// When it was last used, to the minute.
    pub last_used_at_ms: Option<i64>,
    secret_hash: String,
}

impl KeyRow {
    /// Whether it allows something of this scope.
    #[must_use]
    pub fn allows(&self, scope: Scope) -> bool {
        self.scopes.iter().any(|own| *own == scope || *own == Scope::Admin)
    }

    /// Whether it may be used now.
    #[must_use]
    pub fn is_live(&self, now_ms: i64) -> bool {
        self.revoked_at_ms.is_none() && self.expires_at_ms.is_none_or(|end| now_ms < end)
    }

    /// Whether this is its secret.
    #[must_use]
    pub fn has_secret(&self, secret: &str) -> bool {
        self.secret_hash == hash(secret)
    }
}

/// The public part and the secret of a key as its owner sends it; none where it has not the form of one.
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

/// Writes a new key and gives it whole.
async fn enter_key(
    tx: &mut SqliteConnection,
    owner: &str,
    scopes: &[Scope],
    expires_at_ms: Option<i64>,
    now_ms: i64,
) -> StoreResult<String> {
    let id = Uuid::new_v4().simple().to_string()[..12].to_owned();
    // 244 random bits.
    let secret = format!("{}{}", Uuid::new_v4().simple(), Uuid::new_v4().simple());
    let scopes: Vec<&str> = scopes.iter().map(|scope| scope.name()).collect();
    sqlx::query(
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
    /// Makes a key and gives it whole, this once. None where the owner has as many live keys as may be.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn create_key(
        &self,
        owner: &str,
        scopes: &[Scope],
        expires_at_ms: Option<i64>,
        now_ms: i64,
    ) -> StoreResult<Option<String>> {
        let mut tx = self.begin().await?;
        let live: i64 = sqlx::query_scalar(
            "SELECT COUNT(*) FROM keys
             WHERE owner = $1 AND revoked_at_ms IS NULL AND (expires_at_ms IS NULL OR expires_at_ms > $2)",
        )
        .bind(owner)
        .bind(now_ms)
        .fetch_one(&mut *tx)
        .await?;
        if live >= LIVE_KEYS {
            return Ok(None);
        }
        let key = enter_key(&mut tx, owner, scopes, expires_at_ms, now_ms).await?;
        commit(tx, "create_key").await?;
        Ok(Some(key))
    }

    /// Makes a new key with owner and scopes of another one, which ends at a time. None where the owner has two others.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn rotate_key(
        &self,
        old_id: &str,
        old_ends_at_ms: i64,
        expires_at_ms: Option<i64>,
        now_ms: i64,
    ) -> StoreResult<Option<String>> {
        let Some(old) = self.key(old_id).await? else { return Ok(None) };
        let mut tx = self.begin().await?;
        let others: i64 = sqlx::query_scalar(
            "SELECT COUNT(*) FROM keys
             WHERE owner = $1 AND id <> $3 AND revoked_at_ms IS NULL AND (expires_at_ms IS NULL OR expires_at_ms > $2)",
        )
        .bind(&old.owner)
        .bind(now_ms)
        .bind(old_id)
        .fetch_one(&mut *tx)
        .await?;
        // For the time of the overlap there may be one more than otherwise.
        if others >= LIVE_KEYS {
            return Ok(None);
        }
        sqlx::query("UPDATE keys SET expires_at_ms = MIN(COALESCE(expires_at_ms, $2), $2) WHERE id = $1")
            .bind(old_id)
            .bind(old_ends_at_ms)
            .execute(&mut *tx)
            .await?;
        let key = enter_key(&mut tx, &old.owner, &old.scopes, expires_at_ms, now_ms).await?;
        commit(tx, "rotate_key").await?;
        Ok(Some(key))
    }

    /// The key with this public part.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn key(&self, id: &str) -> StoreResult<Option<KeyRow>> {
        let row: Option<Columns> =
            sqlx::query_as(select_key!("WHERE id = $1")).bind(id).fetch_optional(&self.readers).await?;
        Ok(row.map(read))
    }

    /// All keys, the oldest first.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn keys(&self) -> StoreResult<Vec<KeyRow>> {
        let rows: Vec<Columns> =
            sqlx::query_as(select_key!("ORDER BY created_at_ms, id")).fetch_all(&self.readers).await?;
        Ok(rows.into_iter().map(read).collect())
    }

    /// Revokes a key. False where there is none that is not revoked.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn revoke_key(&self, id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let found = sqlx::query("UPDATE keys SET revoked_at_ms = $2 WHERE id = $1 AND revoked_at_ms IS NULL")
            .bind(id)
            .bind(now_ms)
            .execute(&mut *tx)
            .await?
            .rows_affected();
        commit(tx, "revoke_key").await?;
        Ok(found > 0)
    }

    /// Notes when keys were last used, in one transaction.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn note_key_uses(&self, uses: &[(String, i64)]) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        for (id, used_at_ms) in uses {
            sqlx::query("UPDATE keys SET last_used_at_ms = $2 WHERE id = $1")
                .bind(id)
                .bind(used_at_ms)
                .execute(&mut *tx)
                .await?;
        }
        commit(tx, "note_key_uses").await
    }
}
