//! Cancelling a submission.

use super::read::{SubmissionStatus, status, stored};
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::clock::now_ms;
use crate::store::keys::Scope;
use crate::store::states::SubmissionState;

/// Cancels a submission that is queued or being graded. Cancelling it again succeeds as well.
///
/// # Errors
/// Returns an error if there is no such submission, if it belongs to another owner, if it has ended otherwise, or if
/// the database fails.
pub async fn cancel(app: &App, caller: &Caller, id: &str) -> AppResult<SubmissionStatus> {
    caller.require(Scope::Submit)?;
    let row = stored(app, id).await?;
    caller.require_own(row.owner.as_deref(), "submission")?;
    if !app.store.cancel(id, now_ms()).await? {
        let state = stored(app, id).await?.state;
        if state != SubmissionState::Cancelled {
            return Err(AppError::conflict("ended", format!("the submission has ended: {}", state.name())));
        }
    }
    status(app, id).await
}
