//! Time limits within a request for a reward: its work ends before the request itself times out, so that the response
//! can say what that means for the reward.

use std::time::{Duration, Instant};

use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;

/// Time for which the code of a request may wait and run: enough of its time is left to grade and to answer.
const CODE_WITHIN: Duration = Duration::from_secs(LIMITS.grade_code_seconds);

/// Time after which a request is graded, or refused.
pub const GRADED_WITHIN: Duration = Duration::from_secs(LIMITS.grade_seconds);

/// Runs the code of a request within the deadline that its sender asked for, or within `grade_code_seconds`.
///
/// # Errors
/// Returns the errors of the code, 504 if the deadline passes, and 503 if the request would run out of time.
pub async fn code_in_time<T>(asked: Option<Duration>, running: impl Future<Output = AppResult<T>>) -> AppResult<T> {
    const WHAT: &str = "action code waited and ran";
    // The code runner says more about its own deadline, so it gets a second's head start.
    let most = asked.map_or(CODE_WITHIN, |asked| (asked + Duration::from_secs(1)).min(CODE_WITHIN));
    tokio::time::timeout(most, running).await.unwrap_or_else(|_late| match asked {
        Some(asked) => {
            let most = asked.min(CODE_WITHIN);
            let detail = format!("The deadline of {} s passed while {WHAT}.", most.as_secs_f64());
            Err(AppError::new(Kind::Deadline, detail).retry_after(1))
        }
        None => Err(busy(WHAT, most)),
    })
}

/// Grades a request that began at `begun`, before it runs out of time.
///
/// # Errors
/// Returns the errors of the grading, and 503 if the request would run out of time.
pub async fn graded_in_time<T>(begun: Instant, grading: impl Future<Output = AppResult<T>>) -> AppResult<T> {
    let graded = tokio::time::timeout_at((begun + GRADED_WITHIN).into(), grading).await;
    graded.unwrap_or_else(|_late| Err(busy("the request waited and was graded", GRADED_WITHIN).without_reward()))
}

fn busy(what: &str, waited: Duration) -> AppError {
    let detail = format!(
        "The machine has too much to do: {what}, for {} s. The request may be sent again.",
        waited.as_secs_f64()
    );
    AppError::new(Kind::Busy, detail).retry_after(5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_takes_too_long_is_no_reward() {
        let begun = Instant::now().checked_sub(GRADED_WITHIN).expect("the machine runs for longer");
        let late = graded_in_time::<()>(begun, std::future::pending()).await.unwrap_err();
        assert_eq!((late.kind(), late.has_null_reward()), (Kind::Busy, true));
        let late = code_in_time::<()>(Some(Duration::ZERO), std::future::pending()).await.unwrap_err();
        assert_eq!(late.kind(), Kind::Deadline);
        assert_eq!(graded_in_time(Instant::now(), async { Ok(1) }).await.unwrap(), 1);
        assert!(CODE_WITHIN < GRADED_WITHIN);
    }
}
