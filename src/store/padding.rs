//! What of an open epoch's receipts enters the public log at a full minute, so that its growth tells nothing.
//!
//! How many entries, draws and answers there are is public. How long a grading takes is not, and it could tell what was built. So
//! each answer brings two places in the log: its own, and one for a grade or a failure. A grade that is not there yet leaves its place
//! to padding, and takes that of a later answer, or enters at the end of the epoch.

use std::collections::BTreeMap;

use super::db::Tx;
use super::epochs::epoch_in;
use super::evidence::keep;
use super::pending::{Pending, enter_all, take};
use super::secrets::random_key;
use super::{StoreError, StoreResult};
use plumbline_engine::hidden::evidence::{Fact, PaddingFact, fact, receipt};
use plumbline_engine::hidden::receipts::{Signed, Signer};
use plumbline_engine::tasks::hex;

/// Publishes the pending receipts of all epochs, as many as their answers call for, with padding where grades are missing. Grades
/// beyond that wait, so that the growth of the log tells what is public anyway.
pub(super) async fn publish_due(tx: &mut Tx, signer: &Signer) -> StoreResult<()> {
    let mut of_epoch: BTreeMap<String, Vec<Pending>> = BTreeMap::new();
    for pending in take(tx, None).await? {
        of_epoch.entry(pending.epoch_id.clone()).or_default().push(pending);
    }
    let mut due = Vec::new();
    for (epoch_id, pending) in of_epoch {
        let epoch = epoch_in(tx, &epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
        if epoch.commitment.protocol() < 2 || epoch.closed.is_some() {
            due.extend(pending);
            continue;
        }
        let Batch { now, later, padding } = Batch::of(pending)?;
        due.extend(now);
        for receipt in later {
            keep(tx, &epoch_id, receipt.of(), &receipt.signed()?).await?;
        }
        for _ in 0..padding {
            let receipt = receipt(&epoch_id, &random_key()?, &Fact::Padding(PaddingFact {}));
            let Signed { body, hash, signature, public_key } = signer.sign(&receipt);
            let (epoch_id, hash) = (epoch_id.clone(), hex(&hash));
            due.push(Pending { epoch_id, submission_id: None, attempt: None, body, hash, signature, public_key });
        }
    }
    enter_all(tx, due).await
}

/// Receipts of one epoch that are published together.
#[derive(Debug, PartialEq, Eq)]
struct Batch {
    /// Receipts that enter the log now.
    now: Vec<Pending>,
    /// Grades and failures for which there is no place yet.
    later: Vec<Pending>,
    /// Number of places that nothing takes.
    padding: usize,
}

impl Batch {
    /// Divides what is pending. Grades take places in the order of their hashes, which says nothing of their age.
    fn of(mut pending: Vec<Pending>) -> StoreResult<Self> {
        pending.sort_by(|one, other| one.hash.cmp(&other.hash));
        let (mut now, mut grades) = (Vec::new(), Vec::new());
        let mut places = 0;
        for receipt in pending {
            let body =
                serde_json::from_str(&receipt.body).map_err(|error| StoreError::corrupt("pending_receipts", error))?;
            match fact(&body) {
                None | Some(Fact::Failure(_)) => grades.push(receipt),
                Some(stated) => {
                    places += usize::from(matches!(stated, Fact::Answer(_)));
                    now.push(receipt);
                }
            }
        }
        let later = grades.split_off(places.min(grades.len()));
        let padding = places - grades.len();
        now.extend(grades);
        Ok(Self { now, later, padding })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pending(name: &str) -> Pending {
        let body = match name {
            "answer" => {
                r#"{"answer":{"answered_at_ms":1,"entry":"e","instance":"i","log_sha256":"","transcript_sha256":null}}"#
            }
            "completed" => r#"{"completed":{"completed_at_ms":2,"entry":"e","finalized_at_ms":1}}"#,
            "failure" => r#"{"failure":{"failed_at_ms":2,"instance":"i","submission":"s","why":"w"}}"#,
            _ => r#"{"instance":"i","overall":true}"#,
        };
        Pending {
            epoch_id: "e".to_owned(),
            submission_id: None,
            attempt: None,
            body: body.to_owned(),
            hash: name.to_owned(),
            signature: String::new(),
            public_key: String::new(),
        }
    }

    /// Whatever was graded, the log grows by two for each answer, and by one for whatever else is public.
    #[test]
    fn the_log_grows_by_what_is_public() {
        for (names, later, padding) in [
            (vec!["answer", "answer", "completed"], 0, 2),
            (vec!["answer", "grade", "answer", "completed"], 0, 1),
            (vec!["answer", "answer", "grade", "failure", "completed"], 0, 0),
            (vec!["answer", "answer", "grade", "grade", "grade", "completed"], 1, 0),
            (vec!["grade", "completed"], 1, 0),
        ] {
            let public = names.iter().filter(|name| ["answer", "completed"].contains(name)).count();
            let answers = names.iter().filter(|name| **name == "answer").count();
            let batch = Batch::of(names.iter().map(|name| pending(name)).collect()).unwrap();
            assert_eq!((batch.later.len(), batch.padding), (later, padding), "{names:?}");
            assert_eq!(batch.now.len() + batch.padding, public + answers, "{names:?}");
        }
    }
}
