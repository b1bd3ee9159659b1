//! Slow work, off the threads that serve requests.

use crate::app::error::{AppError, AppResult};

/// Does slow work on a blocking thread.
///
/// # Errors
/// Returns the error of the work, or 500 if it panics.
pub(in crate::app) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> AppResult<T> + Send + 'static,
) -> AppResult<T> {
    tokio::task::spawn_blocking(work).await.map_err(|error| AppError::internal(&error))?
}
