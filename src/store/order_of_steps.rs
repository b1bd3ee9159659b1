//! The order of the steps of hidden evaluation: what is signed is dated no earlier than the steps that it follows, also
//! while the clock is behind. `verify-epoch` checks that order.

use sqlx::AssertSqlSafe;

use super::StoreResult;
use super::db::{Tx, query_scalar};

/// Draws and answers that come before a step.
#[derive(Debug, Clone, Copy)]
pub(super) enum StepsOf<'a> {
    /// Those of an instance.
    Instance(&'a str),
    /// Those of an entry.
    Entry(&'a str),
    /// Those of all entries of an epoch.
    Epoch(&'a str),
}

/// Returns a time, or if it is later, that of the last of these draws and answers, in milliseconds since 1970.
pub(super) async fn not_before(tx: &mut Tx, steps: StepsOf<'_>, now_ms: i64) -> StoreResult<i64> {
    let (column, id) = match steps {
        StepsOf::Instance(id) => ("id", id),
        StepsOf::Entry(id) => ("entry_id", id),
        StepsOf::Epoch(id) => ("epoch_id", id),
    };
    let text = format!(
        "SELECT MAX(COALESCE(s.created_at_ms, i.issued_at_ms))
         FROM instances i LEFT JOIN submissions s ON s.instance_id = i.id WHERE i.{column} = $1"
    );
    let last_ms: Option<i64> = query_scalar(AssertSqlSafe(text)).bind(id).fetch_one(tx).await?;
    Ok(last_ms.map_or(now_ms, |last_ms| last_ms.max(now_ms)))
}
