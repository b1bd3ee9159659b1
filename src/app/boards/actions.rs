//! Actions of operators on the rows of boards.

use serde::Deserialize;

use crate::app::App;
use crate::app::access::Caller;
use crate::app::body::changes_direction;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::clock::now_ms;
use crate::store::board_actions::{Acted, ActionKind, NewAction};
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// What is asked of a reason, which has at most `LIMITS.reason_chars`.
pub const REASON_WANTED: &str = "expected 1 to 500 characters, no control characters but line breaks and tabs, and none that change the direction of writing";

const _: () = assert!(LIMITS.reason_chars == 500, "REASON_WANTED names the number");

/// Action that a request may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum HideOrRestore {
    /// Removes the row from the board.
    Hide,
    /// Shows a hidden row again.
    Restore,
}

impl From<HideOrRestore> for ActionKind {
    fn from(kind: HideOrRestore) -> Self {
        match kind {
            HideOrRestore::Hide => Self::Hide,
            HideOrRestore::Restore => Self::Restore,
        }
    }
}

/// An action that was carried out.
#[derive(Debug)]
pub struct Action {
    /// Identifier of the run.
    pub run: String,
    /// Kind of the action.
    pub kind: HideOrRestore,
    /// Owner of the key that the request was sent with.
    pub actor: String,
    /// Reason for the action.
    pub reason: String,
    /// Time of the action, in milliseconds since 1970.
    pub at_ms: i64,
}

/// Hides a finished run from its board, or shows it again. The actor and the reason are public and permanent.
///
/// # Errors
/// Returns an error if the caller is no operator, if the reason is empty or too long, if there is no such run, if it is
/// not finished, if its row is in this state already, or if the database fails.
pub async fn act(app: &App, caller: &Caller, run: String, kind: HideOrRestore, reason: &str) -> AppResult<Action> {
    caller.require(Scope::Admin)?;
    let (actor, reason) = (caller.owner().unwrap_or("anybody").to_owned(), reason_of(reason)?);
    let (stored, at_ms) = (ActionKind::from(kind), now_ms());
    match app.store.act_on_row(&run, &NewAction { kind: stored, actor: &actor, reason: &reason }, at_ms).await? {
        Acted::Done => Ok(Action { run, kind, actor, reason, at_ms }),
        Acted::Already => {
            let is_hide = kind == HideOrRestore::Hide;
            let detail = if is_hide { "the row is already hidden" } else { "the row is not hidden" };
            Err(AppError::conflict("already-so", detail))
        }
        Acted::NoSuchRun => Err(AppError::not_found(format!("there is no run {run:?}"))),
        Acted::NotFinished => {
            let detail = "the run is not finished, so it has no row; an open run is deleted with DELETE /v1/runs/ID";
            Err(AppError::conflict("run-not-finished", detail))
        }
    }
}

/// Returns the reason for an action without surrounding spaces.
///
/// # Errors
/// Returns a fault if it is empty or too long.
fn reason_of(reason: &str) -> AppResult<String> {
    trimmed(reason).ok_or_else(|| {
        let mut faults = Faults::new();
        faults.add_at("reason", REASON_WANTED);
        AppError::faulty(faults)
    })
}

/// Says in words what an action did to a row.
#[must_use]
pub fn past(action: &str) -> &str {
    match action {
        "hide" => "hidden",
        "restore" => "restored",
        "regrade" => "graded again",
        "withdraw" => "withdrawn",
        "reveal" => "name made public",
        other => other,
    }
}

/// Returns a reason without surrounding spaces; none if it is empty or too long, or has characters that control how
/// text is shown.
#[must_use]
pub fn trimmed(reason: &str) -> Option<String> {
    let reason = reason.trim();
    let is_plain =
        !changes_direction(reason) && !reason.contains(|c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t'));
    (is_plain && (1..=LIMITS.reason_chars).contains(&reason.chars().count())).then(|| reason.to_owned())
}
