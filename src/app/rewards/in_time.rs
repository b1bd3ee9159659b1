//! Time for the code of a request: it ends before the request does, so that the answer says what that means for the reward.

use std::time::Duration;

use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;

/// Time for which a request may be prepared: enough of its time is left to grade and to answer.
const PREPARED_WITHIN: Duration = Duration::from_secs(LIMITS.grade_code_seconds);

/// Prepares something within the deadline that its sender asked for, or within what a request may take. Otherwise the
/// request itself would run out of time, which says nothing of the reward.
///
/// # Errors
/// Returns the errors of the preparation, 504 if the deadline passes, and 503 if the request would run out of time.
pub async fn in_time<T>(asked: Option<Duration>, preparing: impl Future<Output = AppResult<T>>) -> AppResult<T> {
    // What runs code says more of a deadline that it notices by itself.
    let most = asked.map_or(PREPARED_WITHIN, |asked| (asked + Duration::from_secs(1)).min(PREPARED_WITHIN));
    tokio::time::timeout(most, preparing).await.unwrap_or_else(|_late| {
        let waited = format!("action code waited and ran, for {} s", most.as_secs_f64());
        Err(match asked {
            Some(_) => AppError::new(Kind::Deadline, format!("The deadline passed while {waited}.")).retry_after(1),
            None => AppError::new(
                Kind::Busy,
                format!("The machine has too much to do: {waited}. The request may be sent again."),
            )
            .retry_after(5),
        })
    })
}
