//! Draws the instances of an entry's runs.

use super::body::NewDrawBody;
use super::draw::decide_draw;
use super::entries::own_entry;
use super::epochs::{not_open, secret_of, stored_epoch};
use super::instances::{IssuedInstance, with_prompts};
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::clock::now_ms;
use crate::near::counted;
use crate::store::draws::{DrawRefusal, Issued, NewDraw};
use crate::store::entries::EntryRow;
use crate::store::epochs::EpochRow;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// Draws the instances of a run, or returns the drawn ones if the nonce is the same. The draft is `None` if its body is
/// no object; `faults` holds the faults of the body so far.
///
/// # Errors
/// Returns all faults of the body, a conflict if the run cannot be drawn, and a refusal if the caller may not
/// act on the entry.
pub async fn draw_run(
    app: &App,
    caller: &Caller,
    entry_id: &str,
    draft: Option<NewDrawBody>,
    mut faults: Faults,
) -> AppResult<Vec<IssuedInstance>> {
    caller.require(Scope::Submit)?;
    let entry = own_entry(app, caller, entry_id).await?;
    let (given, nonce) = draft.map_or((None, None), |draw| (draw.run, draw.nonce));
    let run = given.and_then(|run| u32::try_from(run).ok()).filter(|run| (1..=entry.runs).contains(run));
    if given.is_some() && run.is_none() {
        faults.add_at("run", no_such_run(&entry));
    }
    let (Some(run), Some(nonce), true) = (run, nonce, faults.is_empty()) else {
        return Err(AppError::faulty(faults));
    };
    let epoch = stored_epoch(app, &entry.epoch_id).await?;
    let now = now_ms();
    let secret = secret_of(app, &epoch, now).await?;
    let new = NewDraw { entry_id, run, nonce: &nonce, secret: &secret };
    match app.store.issue_instances(&new, decide_draw, now).await? {
        Issued::Instances(rows) => {
            let mut instances = Vec::with_capacity(rows.len());
            for row in rows {
                instances.push(with_prompts(app, row).await?);
            }
            Ok(instances)
        }
        Issued::Refused(refusal) => Err(refused(refusal, &entry, &epoch)),
    }
}

/// Creates the failure for a run that cannot be drawn.
fn refused(refusal: DrawRefusal, entry: &EntryRow, epoch: &EpochRow) -> AppError {
    match refusal {
        DrawRefusal::NoSuchRun => {
            let mut faults = Faults::new();
            faults.add_at("run", no_such_run(entry));
            AppError::faulty(faults)
        }
        DrawRefusal::OtherNonce => {
            AppError::conflict("already-drawn", "the run has already been drawn, with another nonce")
        }
        DrawRefusal::Closed if entry.finalized_at_ms.is_some() => {
            AppError::conflict("finalized", "the entry is finalized")
        }
        DrawRefusal::Closed => not_open(epoch),
        DrawRefusal::Exhausted => {
            let detail =
                "the reservation of this run has ended, and the epoch's pool has no room for it; nothing was issued";
            AppError::conflict("pool-used-up", detail)
        }
        DrawRefusal::ShareUsedUp(most) => {
            let detail = format!(
                "the reservation of this run has ended, and the owner holds the maximum of {most} runs of the pool; \
                 nothing was issued"
            );
            AppError::conflict("share-used-up", detail)
        }
    }
}

fn no_such_run(entry: &EntryRow) -> String {
    format!("out of range: the entry has {}", counted(entry.runs, "run"))
}
