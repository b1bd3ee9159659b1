//! Group commit: submissions that arrive at the same time become durable together, at the cost of one flush.
//!
//! Requests are independent: if one is refused, or the database fails on it, the others are still stored. The answer
//! goes out only after the commit.

use std::io;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use futures_util::FutureExt as _;
use tokio::sync::{Notify, mpsc, oneshot};

use super::acceptance::{Acceptability, Accepted, Decide, Decision, Facts, ToStore, locks_of, store_all};
use super::db::{Pool, Tx};
use super::idempotency::{IdempotencyKey, PriorRequest};
use super::postgres::notices::Notice;
use super::submissions::NewSubmission;
use super::{Store, StoreError, StoreResult, commit};

/// Maximum number of requests in one transaction; with more, the first would wait long for the last.
const MAX_GROUP: usize = 128;
/// Capacity of the queue; when it is full, callers wait to enqueue their requests.
const WAITING: usize = 1_024;
/// Time for a group. One that takes longer is refused, so that requests hear it before their own time is over, and the
/// next group gets another connection.
const PATIENCE: Duration = Duration::from_secs(10);

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
    pub fn start(writer: Pool, queued: Arc<Notify>) -> Self {
        let (sender, mut receiver) = mpsc::channel(WAITING);
        tokio::spawn(async move {
            let mut group = Vec::with_capacity(MAX_GROUP);
            while receiver.recv_many(&mut group, MAX_GROUP).await > 0 {
                metrics::histogram!("plumbline_accepted_together").record(group.len() as f64);
                // A panic ends the requests of its group, not the task that all later ones need.
                let stored = AssertUnwindSafe(store(&writer, std::mem::take(&mut group))).catch_unwind().await;
                match stored {
                    Ok(true) => queued.notify_waiters(),
                    Ok(false) => {}
                    Err(_panic) => tracing::error!("storing submissions panicked; their requests fail"),
                }
            }
        });
        Self(sender)
    }
}

impl Store {
    /// Stores submissions and their jobs: all of them, or none if one is refused. Requests that arrive at the same time
    /// share a transaction.
    ///
    /// # Errors
    /// Returns an error if the database fails; then nothing is stored.
    pub async fn accept(
        &self,
        submissions: Arc<[NewSubmission]>,
        once: Option<IdempotencyKey>,
        decide: Decide,
        now_ms: i64,
    ) -> StoreResult<Acceptability> {
        let submissions = self.keep_logs(submissions).await?;
        let (answer, answered) = oneshot::channel();
        let closed = || StoreError::Database(sqlx::Error::PoolClosed);
        let acceptance = Acceptance { submissions, once, decide, now_ms, answer };
        self.acceptances.0.send(acceptance).await.map_err(|_| closed())?;
        answered.await.map_err(|_| closed())?
    }
}

/// Stores a group of requests and answers them. Returns whether a job was queued.
async fn store(writer: &Pool, group: Vec<Acceptance>) -> bool {
    match together(writer, &group).await {
        Ok((answers, is_queued)) => {
            for (request, answer) in group.into_iter().zip(answers) {
                // The client may be gone.
                let _ = request.answer.send(Ok(answer));
            }
            is_queued
        }
        // Each would wait for the database as long as the group did.
        Err(error) if error.is_busy() => {
            let error = Arc::new(error);
            for request in group {
                let _ = request.answer.send(Err(StoreError::Group(Arc::clone(&error))));
            }
            false
        }
        Err(_) if group.len() > 1 => {
            // One request failed the whole group: store each on its own.
            let mut is_any_queued = false;
            for request in group {
                let alone = together(writer, std::slice::from_ref(&request)).await;
                is_any_queued |= matches!(alone, Ok((_, true)));
                let answer = alone.map(|(mut answers, _)| answers.pop().expect("one request has one answer"));
                let _ = request.answer.send(answer);
            }
            is_any_queued
        }
        Err(error) => {
            if let Some(request) = group.into_iter().next() {
                let _ = request.answer.send(Err(error));
            }
            false
        }
    }
}

/// Stores the requests in one transaction, and returns their answers and whether a job was queued. A refused request
/// leaves no trace.
async fn together(writer: &Pool, group: &[Acceptance]) -> StoreResult<(Vec<Acceptability>, bool)> {
    let late = |_| sqlx::Error::Io(io::Error::new(io::ErrorKind::TimedOut, "the database takes too long to store"));
    tokio::time::timeout(PATIENCE, Box::pin(store_group(writer, group))).await.map_err(late)?
}

async fn store_group(writer: &Pool, group: &[Acceptance]) -> StoreResult<(Vec<Acceptability>, bool)> {
    let mut tx = writer.begin_writing().await?;
    let all = group.iter().flat_map(|request| request.submissions.iter());
    let once = group.iter().filter_map(|request| request.once.as_ref());
    tx.lock(locks_of(all.clone(), once)).await?;
    let mut facts = Facts::read(&mut tx, all).await?;
    let mut answers = Vec::with_capacity(group.len());
    let mut stored: Vec<ToStore<'_>> = Vec::new();
    for request in group {
        let (answer, new) = decide_request(&mut tx, request, &facts).await?;
        for one in new {
            facts.note(one.new);
            stored.push(one);
        }
        answers.push(answer);
    }
    let Some(now_ms) = group.iter().map(|request| request.now_ms).max() else { return Ok((answers, false)) };
    store_all(&mut tx, &stored, now_ms).await?;
    let is_queued = !stored.is_empty();
    if is_queued {
        tx.notify(Notice::Queued).await?;
    }
    commit(tx, "accept").await?;
    Ok((answers, is_queued))
}

/// Decides on a request, and returns its answer and what it stores. Its result is kept if it has an idempotency key.
async fn decide_request<'a>(
    tx: &mut Tx,
    request: &'a Acceptance,
    facts: &Facts,
) -> StoreResult<(Acceptability, Vec<ToStore<'a>>)> {
    if let Some(once) = &request.once {
        match once.before(tx, request.now_ms).await? {
            PriorRequest::Never => {}
            PriorRequest::Done(result) => return Ok((Acceptability::Replayed(result), Vec::new())),
            PriorRequest::OtherBody => return Ok((Acceptability::KeyUsedOtherwise, Vec::new())),
        }
    }
    let submissions = &request.submissions;
    let mut stored = Vec::with_capacity(submissions.len());
    let mut answers = Vec::with_capacity(submissions.len());
    for (new, decision) in submissions.iter().zip((request.decide)(submissions, facts.about(submissions))) {
        answers.push(match decision {
            Decision::Answer(answer) => answer,
            Decision::Store { supersedes } => {
                stored.push(ToStore { new, supersedes, takes_over: None });
                Accepted::New
            }
        });
    }
    if !answers.iter().all(|answer| matches!(answer, Accepted::New | Accepted::Same(_))) {
        return Ok((Acceptability::Decided(answers), Vec::new()));
    }
    if let Some(once) = &request.once {
        let result: Vec<(&str, bool)> = submissions
            .iter()
            .zip(&answers)
            .map(|(submission, answer)| match answer {
                Accepted::Same(id) => (id.as_str(), true),
                _ => (submission.id.as_str(), false),
            })
            .collect();
        let result = serde_json::to_string(&result).expect("identifiers and truth values are JSON");
        once.keep(tx, &result, request.now_ms).await?;
    }
    Ok((Acceptability::Decided(answers), stored))
}
