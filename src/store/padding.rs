//! Selects the receipts of an open epoch that enter the public log at a full minute, so that the log's growth reveals
//! nothing.
//!
//! The numbers of entries, draws, answers and completions are public. The duration of a grading is not, because it
//! could reveal what was built. Each answer therefore takes two places in the log: its own, and one for a grade or a
//! failure. Padding fills the second place if the grade is not ready. Completing an entry takes as many places as the
//! entry has answers, so that all its grades are in the log by then.

use super::db::{Tx, query_scalar};
use super::epochs::epoch_in;
use super::locks::Lock;
use super::pending::{Pending, enter_all, take, take_grades, take_grades_of, take_others};
use super::secrets::random_key;
use super::{StoreError, StoreResult};
use plumbline_engine::hidden::evidence::{Fact, PaddingFact, fact, receipt};
use plumbline_engine::hidden::receipts::{Signed, Signer};
use plumbline_engine::tasks::hex;

/// Publishes the pending receipts of all epochs, as many as is public anyway, with padding where grades are missing.
pub(super) async fn publish_due(tx: &mut Tx, signer: &Signer) -> StoreResult<()> {
    tx.lock([Lock::Order]).await?;
    let epochs: Vec<String> =
        query_scalar("SELECT DISTINCT epoch_id FROM pending_receipts ORDER BY epoch_id").fetch_all(&mut *tx).await?;
    let mut due = Vec::new();
    for epoch_id in epochs {
        let epoch = epoch_in(tx, &epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
        if epoch.commitment.protocol() < 2 || epoch.closed.is_some() {
            due.extend(take(tx, Some(&epoch_id)).await?);
            continue;
        }
        // What is deleted is what is published: another node may do the same at the same time.
        let others = take_others(tx, &epoch_id).await?;
        let (mut places, mut grades) = (0, Vec::new());
        for receipt in &others {
            match stated(receipt)? {
                Some(Fact::Answer(_)) => places += 1,
                Some(Fact::Completed(completed)) => {
                    places += answers_of(tx, &completed.entry).await?;
                    grades.extend(take_grades_of(tx, &epoch_id, &completed.entry).await?);
                }
                _ => {}
            }
        }
        grades.extend(take_grades(tx, &epoch_id, places.saturating_sub(grades.len())).await?);
        for _ in grades.len()..places {
            due.push(padding(&epoch_id, signer)?);
        }
        due.extend(others);
        due.extend(grades);
    }
    enter_all(tx, due).await
}

/// Counts the answers of an entry.
async fn answers_of(tx: &mut Tx, entry_id: &str) -> StoreResult<usize> {
    let answers: i64 = query_scalar(
        "SELECT COUNT(*) FROM instances i JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE
         WHERE i.entry_id = $1",
    )
    .bind(entry_id)
    .fetch_one(tx)
    .await?;
    usize::try_from(answers).map_err(|error| StoreError::corrupt("instances", error))
}

/// Reads what a receipt states.
fn stated(receipt: &Pending) -> StoreResult<Option<Fact>> {
    let body = serde_json::from_str(&receipt.body).map_err(|error| StoreError::corrupt("pending_receipts", error))?;
    Ok(fact(&body))
}

/// Makes a receipt that fills a place.
fn padding(epoch_id: &str, signer: &Signer) -> StoreResult<Pending> {
    let receipt = receipt(epoch_id, &random_key()?, &Fact::Padding(PaddingFact {}));
    let Signed { body, hash, signature, public_key } = signer.sign(&receipt);
    let (epoch_id, hash) = (epoch_id.to_owned(), hex(&hash));
    Ok(Pending { epoch_id, submission_id: None, attempt: None, body, hash, signature, public_key })
}
