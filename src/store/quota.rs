//! Quota: the number of submissions that owners may make, as a ledger. Every row is written in the transaction of its
//! cause.

use std::collections::{BTreeMap, BTreeSet};

use super::db::{Builder, Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::rows::from_row;
use super::{Store, StoreResult, commit};

/// Maximum number of rows that one statement inserts.
const AT_ONCE: usize = 500;

/// Quota and use of an owner, in submissions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QuotaRow {
    /// Owner of the quota.
    pub owner: String,
    /// Total granted; none means unlimited.
    pub granted: Option<i64>,
    /// Number of submissions that wait or are being graded.
    pub reserved: i64,
    /// Number of submissions that were graded and whose reports were released.
    pub charged: i64,
    /// Number of submissions before the first grant, which do not count against it.
    pub used_before: i64,
}

impl QuotaRow {
    /// Returns the number of submissions left; none means unlimited.
    #[must_use]
    pub fn left(&self) -> Option<i64> {
        self.balance().map(|balance| balance.max(0))
    }

    /// Returns how many more submissions were used than granted, of which a later grant is first taken.
    #[must_use]
    pub fn debt(&self) -> i64 {
        self.balance().map_or(0, |balance| (-balance).max(0))
    }

    fn balance(&self) -> Option<i64> {
        let used = (self.charged + self.reserved - self.used_before).max(0);
        self.granted.map(|granted| granted - used)
    }
}

/// Row of the ledger.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QuotaEntry {
    /// Number of the row; increases with each row.
    pub id: i64,
    /// `grant`, `reserve`, `charge` or `refund`.
    pub kind: String,
    /// Number of submissions.
    pub units: i64,
    /// Identifier of the submission; none for a grant, and for an answer to a hidden instance until its entry is complete:
    /// another one would tell that its grading failed.
    pub submission_id: Option<String>,
    /// Reason for the row.
    pub reason: String,
    /// Time of the row, in milliseconds since 1970.
    pub at_ms: i64,
}

from_row!(QuotaEntry { id, kind, units, submission_id, reason, at_ms });

/// Returns the units that each of these owners may still use. Owners without a limit are left out.
pub(super) async fn left_of(tx: &mut Tx, owners: &BTreeSet<&str>) -> StoreResult<BTreeMap<String, i64>> {
    let mut select = Builder::new(
        "SELECT owner, granted - (charged + reserved - used_before) FROM quotas WHERE granted IS NOT NULL AND owner IN ",
    );
    select.push_list(owners.iter().copied());
    let left: Vec<(String, i64)> = select.build_as().fetch_all(tx).await?;
    Ok(left.into_iter().collect())
}

/// Reserves a unit for each stored submission, given as owner and submission.
pub(super) async fn reserve(tx: &mut Tx, stored: &[(&str, &str)], now_ms: i64) -> StoreResult<()> {
    if stored.is_empty() {
        return Ok(());
    }
    let mut upsert = Builder::new("INSERT INTO quotas (owner, reserved) ");
    upsert.push_values(units_of(stored), |row, (owner, units)| {
        row.push_bind(owner).push_bind(units);
    });
    upsert.push(" ON CONFLICT (owner) DO UPDATE SET reserved = quotas.reserved + excluded.reserved");
    upsert.build().execute(&mut *tx).await?;
    enter(tx, "reserve", "accepted", now_ms, stored).await
}

/// Counts the submissions of each owner, given as owner and submission.
fn units_of<'a>(submissions: &[(&'a str, &str)]) -> BTreeMap<&'a str, i64> {
    let mut owners: BTreeMap<&str, i64> = BTreeMap::new();
    for (owner, _) in submissions {
        *owners.entry(owner).or_default() += 1;
    }
    owners
}

/// Transfers the reservation of a submission to the submission that replaces it.
pub(super) async fn hand_over(tx: &mut Tx, from: &str, to: &str) -> StoreResult<()> {
    query("UPDATE quota_entries SET submission_id = $2 WHERE submission_id = $1 AND kind = 'reserve'")
        .bind(from)
        .bind(to)
        .execute(tx)
        .await?;
    Ok(())
}

/// Charges the owners of graded submissions, given as owner and submission, whose reports are released now.
pub(super) async fn charge(tx: &mut Tx, graded: &[(&str, &str)], now_ms: i64) -> StoreResult<()> {
    if graded.is_empty() {
        return Ok(());
    }
    for (owner, units) in units_of(graded) {
        query("UPDATE quotas SET reserved = reserved - $2, charged = charged + $2 WHERE owner = $1")
            .bind(owner)
            .bind(units)
            .execute(&mut *tx)
            .await?;
    }
    enter(tx, "charge", "graded", now_ms, graded).await
}

/// Refunds the reservation of a submission that ends without a released report.
pub(super) async fn refund(
    tx: &mut Tx,
    owner: &str,
    submission_id: &str,
    reason: &str,
    now_ms: i64,
) -> StoreResult<()> {
    // Use before the first grant cannot exceed total use.
    query(
        "UPDATE quotas SET reserved = reserved - 1,
             used_before = CASE WHEN used_before < charged + reserved THEN used_before ELSE charged + reserved - 1 END
         WHERE owner = $1",
    )
    .bind(owner)
    .execute(&mut *tx)
    .await?;
    enter(tx, "refund", reason, now_ms, &[(owner, submission_id)]).await
}

/// Adds a row of one unit for each owner and submission.
async fn enter(tx: &mut Tx, kind: &'static str, reason: &str, now_ms: i64, of: &[(&str, &str)]) -> StoreResult<()> {
    for part in of.chunks(AT_ONCE) {
        let mut insert = Builder::new("INSERT INTO quota_entries (owner, submission_id, kind, units, reason, at_ms) ");
        insert.push_values(part, |row, (owner, submission_id)| {
            row.push_bind(*owner)
                .push_bind(*submission_id)
                .push_bind(kind)
                .push_bind(1)
                .push_bind(reason)
                .push_bind(now_ms);
        });
        insert.build().execute(&mut *tx).await?;
    }
    Ok(())
}

/// Adds a grant to the ledger.
async fn enter_grant(tx: &mut Tx, owner: &str, units: i64, reason: &str, now_ms: i64) -> StoreResult<()> {
    query("INSERT INTO quota_entries (owner, kind, units, reason, at_ms) VALUES ($1, 'grant', $2, $3, $4)")
        .bind(owner)
        .bind(units)
        .bind(reason)
        .bind(now_ms)
        .execute(tx)
        .await?;
    Ok(())
}

impl Store {
    /// Returns whether an owner is known: by a key, a run, or a quota, which every submission creates.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn knows_owner(&self, owner: &str) -> StoreResult<bool> {
        let found = query_scalar(
            "SELECT EXISTS (SELECT 1 FROM keys WHERE owner = $1) OR EXISTS (SELECT 1 FROM runs WHERE owner = $1)
                 OR EXISTS (SELECT 1 FROM quotas WHERE owner = $1)",
        );
        found.bind(owner).fetch_one(&self.readers).await
    }

    /// Returns all owners that have a key.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn owners(&self) -> StoreResult<Vec<String>> {
        query_scalar("SELECT DISTINCT owner FROM keys ORDER BY owner").fetch_all(&self.readers).await
    }

    /// Lifts the quota of an owner: from now on it is unlimited. Returns false if it was not limited.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn lift_quota(&self, owner: &str, reason: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(owner)]).await?;
        let granted: Option<Option<i64>> =
            query_scalar("SELECT granted FROM quotas WHERE owner = $1").bind(owner).fetch_optional(&mut tx).await?;
        let Some(granted) = granted.flatten() else { return Ok(false) };
        query("UPDATE quotas SET granted = NULL, used_before = 0 WHERE owner = $1")
            .bind(owner)
            .execute(&mut tx)
            .await?;
        enter_grant(&mut tx, owner, -granted, &format!("lifted: {reason}"), now_ms).await?;
        commit(tx, "lift_quota").await?;
        Ok(true)
    }

    /// Grants an owner more submissions, or fewer if `units` is negative. The first grant makes the quota limited, and
    /// earlier use does not count against it.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn grant(&self, owner: &str, units: i64, reason: &str, now_ms: i64) -> StoreResult<QuotaRow> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(owner)]).await?;
        query(
            "INSERT INTO quotas (owner, granted) VALUES ($1, $2)
             ON CONFLICT (owner) DO UPDATE SET
                 used_before = CASE WHEN quotas.granted IS NULL THEN quotas.charged + quotas.reserved ELSE quotas.used_before END,
                 granted = COALESCE(quotas.granted, 0) + excluded.granted",
        )
        .bind(owner)
        .bind(units)
        .execute(&mut tx)
        .await?;
        enter_grant(&mut tx, owner, units, reason, now_ms).await?;
        commit(tx, "grant").await?;
        self.quota(owner).await
    }

    /// Returns quota and use of an owner; unlimited and unused if the owner is unknown.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn quota(&self, owner: &str) -> StoreResult<QuotaRow> {
        let found: Option<(Option<i64>, i64, i64, i64)> =
            query_as("SELECT granted, reserved, charged, used_before FROM quotas WHERE owner = $1")
                .bind(owner)
                .fetch_optional(&self.readers)
                .await?;
        let (granted, reserved, charged, used_before) = found.unwrap_or_default();
        Ok(QuotaRow { owner: owner.to_owned(), granted, reserved, charged, used_before })
    }

    /// Returns at most `limit` rows of an owner's ledger before row `before`, newest first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn quota_entries(&self, owner: &str, before: i64, limit: i64) -> StoreResult<Vec<QuotaEntry>> {
        let rows = query_as(
            "SELECT q.id, q.kind, q.units, q.reason, q.at_ms,
                    CASE WHEN i.id IS NULL OR e.completed_at_ms IS NOT NULL THEN q.submission_id END AS submission_id
             FROM quota_entries q LEFT JOIN submissions s ON s.id = q.submission_id
                  LEFT JOIN instances i ON i.id = s.instance_id LEFT JOIN entries e ON e.id = i.entry_id
             WHERE q.owner = $1 AND q.id < $2 ORDER BY q.id DESC LIMIT $3",
        )
        .bind(owner)
        .bind(before)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        Ok(rows)
    }
}
