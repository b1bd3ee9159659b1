//! Actions on the rows of boards: an operator hides or restores a row, its owner withdraws it.

use super::db::{Tx, query, query_scalar};
use super::locks::Lock;
use super::postgres::notices::Notice;
use super::receipts::announce;
use super::{Store, StoreResult, commit};
use plumbline_engine::hidden::announcements::{Announcement, BoardActionFact};
use plumbline_engine::hidden::receipts::Signer;

/// Action on a row, to be recorded.
#[derive(Debug, Clone, Copy)]
pub struct NewAction<'a> {
    /// Kind of the action.
    pub kind: ActionKind,
    /// Name of whoever acts.
    pub actor: &'a str,
    /// Reason that the actor gives.
    pub reason: &'a str,
}

/// Kind of an action that a request asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActionKind {
    /// The operator removes the row from the board.
    Hide,
    /// The operator shows a hidden row again.
    Restore,
    /// The owner withdraws the run for good.
    Withdraw,
}

impl ActionKind {
    /// Returns the name in the record of actions.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hide => "hide",
            Self::Restore => "restore",
            Self::Withdraw => "withdraw",
        }
    }
}

/// Outcome of an action on a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acted {
    /// The action was carried out.
    Done,
    /// The row already was in this state.
    Already,
    /// There is no such run.
    NoSuchRun,
    /// The run is not finished, so it has no row.
    NotFinished,
}

impl Store {
    /// Acts on the row of a finished run, and records publicly who did it and why.
    ///
    /// # Errors
    /// Returns an error if the database fails, or this node cannot sign.
    pub async fn act_on_row(&self, run_id: &str, new: &NewAction<'_>, now_ms: i64) -> StoreResult<Acted> {
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        tx.lock([Lock::Run(run_id)]).await?;
        let state: Option<String> =
            query_scalar("SELECT state FROM runs WHERE id = $1").bind(run_id).fetch_optional(&mut tx).await?;
        match state.as_deref() {
            None => return Ok(Acted::NoSuchRun),
            Some("finished") => {}
            Some(_) => return Ok(Acted::NotFinished),
        }
        let before: Vec<String> = query_scalar("SELECT action FROM board_actions WHERE run_id = $1 ORDER BY id DESC")
            .bind(run_id)
            .fetch_all(&mut tx)
            .await?;
        let is_hidden = before.iter().find(|action| ["hide", "restore"].contains(&action.as_str()));
        let is_hidden = is_hidden.is_some_and(|action| action == "hide");
        let is_already = match new.kind {
            ActionKind::Hide => is_hidden,
            ActionKind::Restore => !is_hidden,
            ActionKind::Withdraw => before.iter().any(|action| action == "withdraw"),
        };
        if is_already {
            return Ok(Acted::Already);
        }
        enter_action(&mut tx, &signer, run_id, new.kind.name(), new.actor, new.reason, now_ms).await?;
        tx.notify(Notice::Ended { changes_board: true }).await?;
        commit(tx, "act_on_row").await?;
        self.note_ends(true);
        Ok(Acted::Done)
    }
}

/// Records an action on a row, also in the public log.
pub(super) async fn enter_action(
    tx: &mut Tx,
    signer: &Signer,
    run_id: &str,
    action: &str,
    actor: &str,
    reason: &str,
    now_ms: i64,
) -> StoreResult<()> {
    tx.lock([Lock::Order]).await?;
    query("INSERT INTO board_actions (run_id, action, actor, reason, at_ms) VALUES ($1, $2, $3, $4, $5)")
        .bind(run_id)
        .bind(action)
        .bind(actor)
        .bind(reason)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
    let fact = BoardActionFact::of(run_id, action, reason, now_ms);
    announce(tx, signer, &Announcement::BoardAction(fact)).await
}
