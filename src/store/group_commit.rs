//! Group commit: submissions that arrive at the same time become durable together, at the cost of one flush.
//!
//! Requests are independent: if one is refused, or the database fails on it, the others are still stored. The answer
//! goes out only after the commit.

use std::sync::Arc;

use sqlx::{Connection as _, SqliteConnection, SqlitePool};
use tokio::sync::{Notify, mpsc, oneshot};

use super::idempotency::{IdempotencyKey, PriorRequest};
use super::submissions::{Acceptability, Accepted, Decide, NewSubmission, accept_one};
use super::{StoreError, StoreResult, commit};

/// Maximum number of requests in one transaction; with more, the first would wait long for the last.
const MAX_GROUP: usize = 128;
/// Capacity of the queue; when it is full, callers wait to enqueue their requests.
const WAITING: usize = 1_024;

/// Submissions of one request, of which all are stored or none.
#[derive(Debug)]
pub(super) struct Acceptance {
    submissions: Arc<[NewSubmission]>,
    once: Option<IdempotencyKey>,
    decide: Decide,
    now_ms: i64,
    answer: oneshot::Sender<StoreResult<Acceptability>>,
}

/// Handle that sends requests to the task that stores them.
#[derive(Debug, Clone)]
pub(super) struct Acceptances(mpsc::Sender<Acceptance>);

impl Acceptances {
    /// Starts the task. It ends when the last handle is dropped.
    pub fn start(writer: SqlitePool, queued: Arc<Notify>) -> Self {
        let (sender, mut receiver) = mpsc::channel(WAITING);
        tokio::spawn(async move {
            let mut group = Vec::with_capacity(MAX_GROUP);
            while receiver.recv_many(&mut group, MAX_GROUP).await > 0 {
                metrics::histogram!("plumbline_accepted_together").record(group.len() as f64);
                store(&writer, std::mem::take(&mut group)).await;
                queued.notify_waiters();
            }
        });
        Self(sender)
    }

    /// Stores the submissions of one request; see [`super::Store::accept`].
    pub async fn store(
        &self,
        submissions: Arc<[NewSubmission]>,
        once: Option<IdempotencyKey>,
        decide: Decide,
        now_ms: i64,
    ) -> StoreResult<Acceptability> {
        let (answer, answered) = oneshot::channel();
        let closed = || StoreError::Database(sqlx::Error::PoolClosed);
        self.0.send(Acceptance { submissions, once, decide, now_ms, answer }).await.map_err(|_| closed())?;
        answered.await.map_err(|_| closed())?
    }
}

async fn store(writer: &SqlitePool, group: Vec<Acceptance>) {
    match together(writer, &group).await {
        Ok(answers) => {
            for (request, answers) in group.into_iter().zip(answers) {
                // The client may be gone.
                let _ = request.answer.send(Ok(answers));
            }
        }
        Err(_) if group.len() > 1 => {
            // One request failed the whole group: store each on its own.
            for request in group {
                let alone = together(writer, std::slice::from_ref(&request)).await;
                let _ = request
                    .answer
                    .send(alone.map(|mut answers| answers.pop().unwrap_or_else(|| Acceptability::Decided(Vec::new()))));
            }
        }
        Err(error) => {
            if let Some(request) = group.into_iter().next() {
                let _ = request.answer.send(Err(error));
            }
        }
    }
}

/// Stores the requests in one transaction. A refused request leaves no trace.
async fn together(writer: &SqlitePool, group: &[Acceptance]) -> StoreResult<Vec<Acceptability>> {
    let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
    let mut all = Vec::with_capacity(group.len());
    for request in group {
        // A single submission that is refused has written nothing, so it needs no savepoint.
        if let ([only], None) = (&*request.submissions, &request.once) {
            let answer = accept_one(&mut tx, only, request.decide, request.now_ms).await?;
            all.push(Acceptability::Decided(vec![answer]));
            continue;
        }
        let mut part = tx.begin().await?;
        let (answer, is_stored) = store_request(&mut part, request).await?;
        if is_stored {
            part.commit().await?;
        } else {
            part.rollback().await?;
        }
        all.push(answer);
    }
    commit(tx, "accept").await?;
    Ok(all)
}

/// Stores the submissions of one request, and its result if the request has an idempotency key. Returns whether to keep
/// the changes.
async fn store_request(tx: &mut SqliteConnection, request: &Acceptance) -> StoreResult<(Acceptability, bool)> {
    if let Some(once) = &request.once {
        match once.before(tx, request.now_ms).await? {
            PriorRequest::Never => {}
            PriorRequest::Done(result) => return Ok((Acceptability::Replayed(result), false)),
            PriorRequest::OtherBody => return Ok((Acceptability::KeyUsedOtherwise, false)),
        }
    }
    let mut answers = Vec::with_capacity(request.submissions.len());
    for submission in &*request.submissions {
        answers.push(accept_one(tx, submission, request.decide, request.now_ms).await?);
    }
    let is_stored = answers.iter().all(|answer| matches!(answer, Accepted::New | Accepted::Same(_)));
    if let (Some(once), true) = (&request.once, is_stored) {
        let result: Vec<(&str, bool)> = request
            .submissions
            .iter()
            .zip(&answers)
            .map(|(submission, answer)| match answer {
                Accepted::Same(id) => (id.as_str(), true),
                _ => (submission.id.as_str(), false),
            })
            .collect();
        let result = serde_json::to_string(&result).map_err(|error| StoreError::corrupt("idempotency", error))?;
        once.keep(tx, &result, request.now_ms).await?;
    }
    Ok((Acceptability::Decided(answers), is_stored))
}
