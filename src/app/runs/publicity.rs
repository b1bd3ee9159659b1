//! What an owner decides about a run in public. It may withdraw a finished run, of which a trace stays and which still
//! counts as an attempt, and lift an embargo early.

use super::body::WithdrawalBody;
use super::changes::own_run;
use super::read::stored;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult, Kind};
use crate::clock::now_ms;
use crate::store::board_actions::{Acted, ActionKind, NewAction};
use crate::store::run_rows::RunRow;
use crate::store::states::RunState;
use plumbline_engine::intake::Faults;

/// Name under which the owner of an anonymous run acts.
const ANONYMOUS: &str = "its owner";

/// Withdraws a finished run for good. Returns the run.
///
/// # Errors
/// Returns an error if there is no such run, if it belongs to another owner, if the reason is empty or too long, if the
/// run has not finished, or if it was withdrawn before.
pub async fn withdraw(
    app: &App,
    caller: &Caller,
    id: &str,
    draft: Option<WithdrawalBody>,
    faults: Faults,
) -> AppResult<RunRow> {
    let run = own_run(app, caller, id).await?;
    app.require_manager_of_members(caller).await?;
    // Withdrawing is for good, so nobody does it to a run that may be somebody else's.
    if !caller.owns(run.owner.as_deref()) {
        let detail = "the run has no owner, so only the operator can withdraw it: a key with the scope \"admin\"";
        return Err(AppError::new(Kind::Forbidden, detail));
    }
    let (Some(WithdrawalBody { reason: Some(reason) }), true) = (draft, faults.is_empty()) else {
        return Err(AppError::faulty(faults));
    };
    let actor = actor_of(caller, &run);
    let action = NewAction { kind: ActionKind::Withdraw, actor, reason: &reason };
    match app.store.act_on_row(id, &action, now_ms()).await? {
        Acted::Done => stored(app, id).await,
        Acted::Already => Err(AppError::conflict("already-so", "the run is already withdrawn")),
        Acted::NoSuchRun => Err(AppError::not_found(format!("there is no run {id:?}"))),
        Acted::NotFinished => {
            let remedy = match run.state {
                RunState::Open => "delete it instead: DELETE /v1/runs/{id}",
                RunState::Deleted => "it is on no board",
                RunState::Finishing | RunState::Finished => "wait until it has finished",
            };
            let detail = format!("the run is {}, and only a finished run can be withdrawn; {remedy}", run.state.name());
            Err(AppError::conflict("run-not-finished", detail))
        }
    }
}

/// Returns the name under which a caller acts on a run in public.
fn actor_of<'a>(caller: &'a Caller, run: &RunRow) -> &'a str {
    match caller.owner() {
        Some(owner) if run.embargo.is_some() && run.owner.as_deref() == Some(owner) => ANONYMOUS,
        owner => owner.unwrap_or("anybody"),
    }
}

/// Lifts the embargo of a run early. Returns the run.
///
/// # Errors
/// Returns an error if there is no such run, if it belongs to another owner, or if no embargo holds for it.
pub async fn lift(app: &App, caller: &Caller, id: &str) -> AppResult<RunRow> {
    own_run(app, caller, id).await?;
    app.require_manager_of_members(caller).await?;
    let actor = caller.owner().unwrap_or("anybody");
    if !app.store.lift_embargo(id, actor, now_ms()).await? {
        return Err(AppError::conflict("no-embargo", "the run is not under embargo"));
    }
    stored(app, id).await
}
