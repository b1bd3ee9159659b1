//! Notices between nodes: a transaction that queues jobs or ends submissions says so to all nodes.
//!
//! A notice only shortens waiting. Every reader also looks by itself from time to time, so a lost notice, or a pooler
//! that passes none on, costs some hundreds of milliseconds and nothing else.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use sqlx::PgPool;
use sqlx::postgres::{PgListener, PgPoolOptions};
use tokio::sync::Notify;
use tokio::time::timeout;

use super::silence::{self, SIGN, broken_after};
use crate::store::StoreResult;
use crate::store::db::{Tx, query};

/// Channel of notices about queued jobs.
const QUEUED: &str = "plumbline_queued";
/// Channel of notices about ended submissions and runs, and about changes of boards.
const ENDED: &str = "plumbline_ended";
/// Payload of a notice that says that a board changed.
const BOARD: &str = "board";
/// Pause before a connection that failed is opened again.
const PAUSE: Duration = Duration::from_secs(1);
/// Time without a notice after which a listener asks whether its connection is still there.
const QUIET: Duration = Duration::from_secs(30);

/// Subject of a notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::store) enum Notice {
    /// Jobs were queued.
    Queued,
    /// Submissions or runs ended, or a board changed.
    Ended {
        /// Whether a board changed.
        changes_board: bool,
    },
}

impl Tx {
    /// Tells all nodes once the transaction is committed. Does nothing on SQLite, whose file one process serves.
    pub(in crate::store) async fn notify(&mut self, notice: Notice) -> StoreResult<()> {
        if matches!(self, Self::Sqlite { .. }) {
            return Ok(());
        }
        let (channel, what) = match notice {
            Notice::Queued => (QUEUED, ""),
            Notice::Ended { changes_board: false } => (ENDED, ""),
            Notice::Ended { changes_board: true } => (ENDED, BOARD),
        };
        query("SELECT pg_notify($1, $2)").bind(channel).bind(what).execute(self).await?;
        Ok(())
    }
}

/// Passes the notices of all nodes on to the waiting tasks of this process, for as long as the pool is open.
pub(in crate::store) fn follow(pool: PgPool, queued: Arc<Notify>, ends: Arc<Notify>, boards: Arc<AtomicU64>) {
    tokio::spawn(async move {
        while !pool.is_closed() {
            let listening = Box::pin(listen(&pool, &queued, &ends, &boards));
            let ended = pool.close_event().do_until(listening).await;
            if let Ok(Err(error)) = ended {
                tracing::warn!(%error, "no notices from other nodes; looking from time to time instead");
                tokio::time::sleep(PAUSE).await;
            }
        }
    });
}

async fn listen(pool: &PgPool, queued: &Notify, ends: &Notify, boards: &AtomicU64) -> Result<(), sqlx::Error> {
    // A listener that is given up never returns its connection, so it has a pool of its own.
    let options = pool.connect_options().as_ref().clone();
    let own = PgPoolOptions::new().max_connections(1).acquire_timeout(SIGN).connect_lazy_with(options);
    let mut listener = PgListener::connect_with(&own).await?;
    silence::answer(listener.listen_all([QUEUED, ENDED])).await?;
    loop {
        let Ok(notice) = timeout(QUIET, listener.try_recv()).await else {
            // Nothing happened on any node, or the connection is dead.
            broken_after(SIGN, sqlx::query("SELECT 1").execute(&mut listener)).await?;
            continue;
        };
        // Notices of the time before the connection are lost, so everybody looks once.
        match notice? {
            Some(notice) if notice.channel() == QUEUED => queued.notify_waiters(),
            Some(notice) => {
                if notice.payload() == BOARD {
                    boards.fetch_add(1, Ordering::AcqRel);
                }
                ends.notify_waiters();
            }
            None => {
                boards.fetch_add(1, Ordering::AcqRel);
                queued.notify_waiters();
                ends.notify_waiters();
            }
        }
    }
}
