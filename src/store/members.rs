//! Members of owners: people or programs with a role, to whom keys belong.

use super::db::{query, query_as, query_scalar};
use super::keys::Role;
use super::locks::Lock;
use super::{Store, StoreResult, commit};

/// Member of an owner.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MemberRow {
    /// Name of the member.
    pub name: String,
    /// Role of the member.
    pub role: Role,
    /// Time at which it was added, in milliseconds since 1970.
    pub created_at_ms: i64,
}

/// Outcome of adding or changing a member.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemberPut {
    /// The member was added.
    Added,
    /// The member existed, and has the role now.
    Changed,
    /// The owner has the maximum number of members.
    Full,
}

impl Store {
    /// Adds a member of an owner, unless there are `most` already, or gives an existing one this role.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn put_member(
        &self,
        owner: &str,
        name: &str,
        role: Role,
        most: i64,
        now_ms: i64,
    ) -> StoreResult<MemberPut> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(owner)]).await?;
        let changed = query("UPDATE members SET role = $3 WHERE owner = $1 AND name = $2")
            .bind(owner)
            .bind(name)
            .bind(role.name())
            .execute(&mut tx)
            .await?;
        if changed == 0 {
            let count: i64 =
                query_scalar("SELECT COUNT(*) FROM members WHERE owner = $1").bind(owner).fetch_one(&mut tx).await?;
            if count >= most {
                return Ok(MemberPut::Full);
            }
            query("INSERT INTO members (owner, name, role, created_at_ms) VALUES ($1, $2, $3, $4)")
                .bind(owner)
                .bind(name)
                .bind(role.name())
                .bind(now_ms)
                .execute(&mut tx)
                .await?;
        }
        commit(tx, "put_member").await?;
        Ok(if changed > 0 { MemberPut::Changed } else { MemberPut::Added })
    }

    /// Removes a member and revokes its keys. Returns false if there is no such member.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn remove_member(&self, owner: &str, name: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(owner)]).await?;
        let removed = query("DELETE FROM members WHERE owner = $1 AND name = $2").bind(owner).bind(name);
        if removed.execute(&mut tx).await? == 0 {
            return Ok(false);
        }
        query("UPDATE keys SET revoked_at_ms = $3 WHERE owner = $1 AND member = $2 AND revoked_at_ms IS NULL")
            .bind(owner)
            .bind(name)
            .bind(now_ms)
            .execute(&mut tx)
            .await?;
        commit(tx, "remove_member").await?;
        Ok(true)
    }

    /// Returns the members of an owner, by name.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn members(&self, owner: &str) -> StoreResult<Vec<MemberRow>> {
        let rows: Vec<(String, String, i64)> =
            query_as("SELECT name, role, created_at_ms FROM members WHERE owner = $1 ORDER BY name")
                .bind(owner)
                .fetch_all(&self.readers)
                .await?;
        let row = |(name, role, created_at_ms): (String, String, i64)| {
            let role = Role::named(&role).expect("the table has only these roles");
            MemberRow { name, role, created_at_ms }
        };
        Ok(rows.into_iter().map(row).collect())
    }

    /// Revokes all live keys of an owner and of its members. Returns their public parts.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn revoke_keys_of(&self, owner: &str, now_ms: i64) -> StoreResult<Vec<String>> {
        let mut tx = self.begin().await?;
        // A manager makes keys meanwhile, and none of them may be left.
        tx.lock([Lock::Owner(owner)]).await?;
        let live: Vec<String> = query_scalar(
            "UPDATE keys SET revoked_at_ms = $2
             WHERE owner = $1 AND revoked_at_ms IS NULL AND (expires_at_ms IS NULL OR expires_at_ms > $2) RETURNING id",
        )
        .bind(owner)
        .bind(now_ms)
        .fetch_all(&mut tx)
        .await?;
        commit(tx, "revoke_keys_of").await?;
        Ok(live)
    }
}
