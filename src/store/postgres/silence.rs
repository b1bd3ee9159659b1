//! Silent connections: neither data nor an error arrives, because the server's machine is gone or something in between
//! dropped the connection.
//!
//! The server's own timeouts do not help then, and TCP waits for a quarter of an hour, or forever.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use sqlx::{Connection as _, PgConnection};

/// Time after which a statement without an answer has failed. The server ends statements before it.
const STATEMENT: Duration = Duration::from_secs(65);
/// Time that a connection gets to say that it is still there, or to close.
pub(in crate::store) const SIGN: Duration = Duration::from_secs(5);

/// Whether statements may take as long as they need.
static IS_PATIENT: AtomicBool = AtomicBool::new(false);
/// Time after which a statement of a patient process has failed.
const PATIENT: Duration = Duration::from_hours(24);

/// Lets statements of this process take as long as they need: it copies a whole database, and serves nobody.
pub(in crate::store) fn be_patient() {
    IS_PATIENT.store(true, Ordering::Relaxed);
}

/// Waits for a statement.
pub(in crate::store) fn answer<'s, T>(
    statement: impl Future<Output = sqlx::Result<T>> + Send + 's,
) -> impl Future<Output = sqlx::Result<T>> + Send + 's {
    broken_after(if IS_PATIENT.load(Ordering::Relaxed) { PATIENT } else { STATEMENT }, statement)
}

/// Waits for the server for a while.
///
/// # Errors
/// Returns an error of the connection if nothing came in that time.
pub(super) fn broken_after<'s, T>(
    limit: Duration,
    work: impl Future<Output = sqlx::Result<T>> + Send + 's,
) -> impl Future<Output = sqlx::Result<T>> + Send + 's {
    // The futures of sqlx are large, and callers would hold them within their own.
    let work = tokio::time::timeout(limit, Box::pin(work));
    let silent = |_| io::Error::new(io::ErrorKind::TimedOut, "the server does not answer");
    async move { work.await.map_err(silent)? }
}

/// Returns whether a connection may serve again. The pool asks so too when it takes one back, but without a time limit.
pub(super) async fn still_answers(connection: &mut PgConnection) -> sqlx::Result<bool> {
    broken_after(SIGN, connection.ping()).await.map(|()| true)
}
