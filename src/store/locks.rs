//! Locks that keep writing transactions of several processes apart.
//!
//! SQLite has one writer, so every transaction is alone already. On PostgreSQL transactions run side by side, and
//! everything that is checked and then written takes a lock first: on the run, the owner, the epoch that it concerns.
//! Locks are held until the transaction ends.
//!
//! Rows that readers follow by number (events, results, actions on boards, runs begun, receipts) are written under
//! [`Lock::Order`], the last lock of each transaction: so they become visible in the order of their numbers, and a
//! reader that remembers the last number misses none.

use super::StoreResult;
use super::db::{Builder, Tx};

/// Subject of a lock, in the order in which transactions take them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Lock<'a> {
    /// An idempotency key of an owner.
    Request(&'a str, &'a str),
    /// Everything that belongs to an epoch of hidden evaluation.
    Epoch(&'a str),
    /// A configuration of an agent, which one owner registers in all epochs.
    Configuration(&'a str),
    /// A run and its submissions.
    Run(&'a str),
    /// The card of a run or an entry.
    Card(&'a str),
    /// Quota, keys and queued jobs of an owner.
    Owner(&'a str),
    /// A webhook and its deliveries.
    Webhook(&'a str),
    /// The suites.
    Suites,
    /// Regrades and the rows of boards.
    Boards,
    /// The order of rows that readers follow by number. Always the last.
    Order,
}

impl Lock<'_> {
    /// Returns a text that no other lock has.
    fn key(self) -> String {
        match self {
            Self::Request(owner, key) => format!("request {} {owner} {key}", owner.len()),
            Self::Epoch(id) => format!("epoch {id}"),
            Self::Configuration(hash) => format!("configuration {hash}"),
            Self::Run(id) => format!("run {id}"),
            Self::Card(id) => format!("card {id}"),
            Self::Owner(owner) => format!("owner {owner}"),
            Self::Webhook(id) => format!("webhook {id}"),
            Self::Suites => "suites".to_owned(),
            Self::Boards => "boards".to_owned(),
            Self::Order => "order".to_owned(),
        }
    }
}

impl Tx {
    /// Takes locks, in an order that is the same for all transactions. Does nothing on SQLite.
    pub(super) async fn lock<'a>(&mut self, locks: impl IntoIterator<Item = Lock<'a>>) -> StoreResult<()> {
        if matches!(self, Self::Sqlite { .. }) {
            return Ok(());
        }
        let mut locks: Vec<Lock<'a>> = locks.into_iter().collect();
        locks.sort_unstable();
        locks.dedup();
        if locks.is_empty() {
            return Ok(());
        }
        let mut take = Builder::new("SELECT pg_advisory_xact_lock(hashtextextended(key, 0)) FROM (");
        take.push_values(locks.iter().enumerate(), |row, (i, lock)| {
            row.push_bind(i as i64).push_bind(lock.key());
        });
        take.push(") AS wanted (position, key) ORDER BY position");
        take.build().execute(self).await?;
        Ok(())
    }
}
