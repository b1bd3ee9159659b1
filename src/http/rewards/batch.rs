//! Grading many logs in one request. Results stream back as they are ready, each with its own status.

use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use axum::body::{Body, HttpBody};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use futures_util::FutureExt as _;
use hyper::body::Frame;
use serde::Serialize;
use tokio::sync::{Semaphore, mpsc};
use tokio::task::JoinSet;

use super::batch_items::{Item, split};
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::app::rewards::grade::ReadRequest;
use crate::app::rewards::grader::{Deadline, Length, Until};
use crate::app::rewards::request::NewGrade;
use crate::app::rewards::score::GradeBody;
use crate::app::submissions::posted::Format;
use crate::http::extract::body::JsonBody;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::catalogue::Catalogue;

/// Greatest number of logs in a chunk, which is what a worker takes at a time from those that are left.
const CHUNK: usize = 8;
/// Number of logs of a batch, for each core, that are graded at a time outside the time slices.
const SLOW_AT_A_TIME: usize = 2;
/// Number of logs of a batch whose code runs or waits, that wait to be graded, or whose result waits for a slow client.
const SLOW_IN_ALL: usize = 64;
/// Length of a time slice, after which other senders get theirs.
const SLICE: Duration = Duration::from_millis(5);
/// Results that wait for a slow client: at most this many time slices, each of about `SLICE_BYTES` bytes.
const WAITING: usize = 4;
const SLICE_BYTES: usize = 1 << 20;
/// Up to this size, lines are found on the thread that serves the request, mostly sooner than another thread would begin.
const SMALL_BODY: usize = 1 << 18;

/// The result of one log of a batch.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BatchItem {
    /// Index of the log in the request, from 0.
    pub index: usize,
    /// HTTP status that the log would have received in a request of its own.
    #[schema(minimum = 200, maximum = 599, example = 200)]
    pub status: u16,
    /// Reward; null if there is none.
    #[schema(minimum = 0, maximum = 1)]
    pub reward: Option<f64>,
    /// Scores, if the log was graded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub result: Option<GradeBody>,
    /// Problem, if the log was not graded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}

/// Grades many logs.
///
/// The body is NDJSON with one request per line, or a JSON array of requests. The response is NDJSON with one line per
/// log, sent as soon as the log is graded, in any order; `index` identifies the log. A log that fails does not affect
/// the others.
#[utoipa::path(
    post, path = "/v1/grade:batch", operation_id = "grade_batch", tag = "rewards", summary = "Grade many logs at once",
    request_body(content((Vec<NewGrade> = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 200, description = "One `BatchItem` per line", body = String, content_type = "application/x-ndjson",
         example = "{\"index\":0,\"status\":200,\"reward\":1.0}\n"),
    )
)]
pub async fn grade_batch(State(state): State<AppState>, caller: Caller, body: JsonBody) -> AppResult<Response> {
    caller.require(Scope::Grade)?;
    let permit = state.grader.admit_batch(caller.who())?;
    let JsonBody { bytes, format, share } = body;
    let catalogue = state.current_catalogue().await?;
    let (bytes, items) = if format == Format::NdJson && bytes.len() <= SMALL_BODY {
        let items = split(&bytes, format)?;
        (bytes, items)
    } else {
        let splitting = tokio::task::spawn_blocking(move || split(&bytes, format).map(|items| (bytes, items)));
        splitting.await.map_err(|error| AppError::internal(&error))??
    };
    let (sender, receiver) = mpsc::channel(WAITING);
    let who = Arc::clone(caller.who());
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    // Several chunks for each core let those that are done early take more.
    let chunk = items.len().div_ceil(8 * cores).min(CHUNK);
    let grading = Semaphore::new(SLOW_AT_A_TIME * cores);
    let batch = Arc::new(Batch { state, who, catalogue, bytes, items, chunk, next: AtomicUsize::new(0), grading });
    let held = Arc::new((permit, share));
    let (slow, of_slow) = mpsc::unbounded_channel();
    for _ in 0..cores.min(batch.items.len().div_ceil(chunk)) {
        let (batch, slow, sender, held) = (Arc::clone(&batch), slow.clone(), sender.clone(), Arc::clone(&held));
        tokio::spawn(async move {
            let _held = held;
            // Work for a client that has disconnected ends here.
            tokio::select! {
                () = batch.work(&sender, &slow) => {}
                () = sender.closed() => {}
            }
        });
    }
    drop(slow);
    tokio::spawn(async move {
        let _held = held;
        tokio::select! {
            () = batch.work_slowly(&sender, of_slow) => {}
            () = sender.closed() => {}
        }
    });
    let kind = [(header::CONTENT_TYPE, "application/x-ndjson")];
    Ok((kind, Body::new(Chunks(receiver))).into_response())
}

struct Batch {
    state: AppState,
    who: Arc<str>,
    catalogue: Arc<Catalogue>,
    bytes: Bytes,
    items: Vec<Item>,
    /// Number of logs in a chunk.
    chunk: usize,
    /// The first log that no worker has taken.
    next: AtomicUsize,
    /// Permits to grade outside the time slices. Whoever waits for one takes no slot meanwhile, where time counts.
    grading: Semaphore,
}

/// What a time slice on the threads for short work did.
#[derive(Default)]
struct Slice {
    lines: Vec<u8>,
    /// Logs that a time slice cannot finish: they have action code, or take long.
    slow: Vec<usize>,
    /// The rest of the last chunk, which the time slice was too short for.
    begun: Range<usize>,
}

impl Batch {
    /// Takes a chunk, which is empty if none is left.
    fn next_chunk(&self) -> Range<usize> {
        let first = self.next.fetch_add(self.chunk, Ordering::Relaxed).min(self.items.len());
        first..(first + self.chunk).min(self.items.len())
    }

    /// Grades one chunk after the other until none is left, and passes slow logs on.
    async fn work(self: &Arc<Self>, sender: &mpsc::Sender<Bytes>, slow: &mpsc::UnboundedSender<usize>) {
        loop {
            let mut left = self.next_chunk();
            if left.is_empty() {
                return;
            }
            while !left.is_empty() {
                let (batch, chunk) = (Arc::clone(self), left.clone());
                let patience = Duration::from_secs(LIMITS.grade_batch_wait_seconds);
                // A slice that begins late has as long as any other.
                let patience = Deadline { work: patience, wait: Some(patience) };
                let work = move |until: &Until| Ok(batch.grade_slice(chunk, until));
                let slice = match self.state.grader.run(Length::Short, &self.who, patience, work).await {
                    Ok(slice) => slice,
                    Err(error) => {
                        let mut slice = Slice { begun: left.end..left.end, ..Slice::default() };
                        let problem = Problem::from(error.without_reward());
                        left.clone()
                            .for_each(|index| write_line(&mut slice.lines, &self.failed(index, problem.clone())));
                        slice
                    }
                };
                left = slice.begun;
                for index in slice.slow {
                    // The receiver goes when the client does.
                    let _ = slow.send(index);
                }
                if !slice.lines.is_empty() && sender.send(slice.lines.into()).await.is_err() {
                    return;
                }
            }
        }
    }

    /// Finishes slow logs as they come, many at a time, each in a task of its own: code that ends soon passes code that does
    /// not, as long as a sender has a free slot.
    async fn work_slowly(self: &Arc<Self>, sender: &mpsc::Sender<Bytes>, mut slow: mpsc::UnboundedReceiver<usize>) {
        let mut running = JoinSet::new();
        while let Some(index) = slow.recv().await {
            if running.len() >= SLOW_IN_ALL {
                running.join_next().await;
            }
            let slot = self.state.grader.slow_slots.take(&self.who).await;
            let (batch, sender) = (Arc::clone(self), sender.clone());
            running.spawn(async move {
                let graded = AssertUnwindSafe(batch.finish(index)).catch_unwind().await;
                let mut line = Vec::new();
                // A panic costs only its own log the result.
                write_line(&mut line, &batch.item(index, graded.unwrap_or_else(|_panic| Err(panicked()))));
                // Others need not wait for a client that does not read.
                drop(slot);
                // The client may have left.
                let _ = sender.send(line.into()).await;
            });
        }
        while running.join_next().await.is_some() {}
    }

    /// Grades a chunk and those after it until the time slice ends. It leaves the slow ones.
    fn grade_slice(&self, mut chunk: Range<usize>, until: &Until) -> Slice {
        let begun = Instant::now();
        let mut slice = Slice::default();
        while begun.elapsed() < SLICE && slice.lines.len() < SLICE_BYTES && !until.has_left() {
            // Handing over a slice costs time, so it goes on with logs that no worker has taken.
            if chunk.is_empty() {
                chunk = self.next_chunk();
            }
            let Some(index) = chunk.next() else { break };
            let written = slice.lines.len();
            let done = catch_unwind(AssertUnwindSafe(|| match self.grade_now(index, until) {
                Ok(Some(graded)) => write_line(&mut slice.lines, &self.item(index, Ok(graded))),
                Ok(None) => slice.slow.push(index),
                Err(error) => write_line(&mut slice.lines, &self.item(index, Err(error))),
            }));
            if done.is_err() {
                // A panic costs only its own log the result.
                slice.lines.truncate(written);
                write_line(&mut slice.lines, &self.item(index, Err(panicked())));
            }
        }
        slice.begun = chunk;
        slice
    }

    /// Reads the request of an item.
    fn read(&self, index: usize) -> AppResult<ReadRequest> {
        let Item { range, line } = &self.items[index];
        let text = &self.bytes[range.clone()];
        match *line {
            Some(line) => ReadRequest::read_line(text, line, &self.catalogue),
            None => ReadRequest::read(text, &self.catalogue),
        }
    }

    /// Grades an item, unless it is slow.
    fn grade_now(&self, index: usize, until: &Until) -> AppResult<Option<GradeBody>> {
        let found = self.read(index)?.find_log()?;
        if found.is_incomplete() {
            return Ok(None);
        }
        let prepared = found.finish(Vec::new(), Faults::new())?;
        if !prepared.is_short(&self.state) {
            return Ok(None);
        }
        prepared.grade_here(&self.state, until).map(Some)
    }

    /// Grades a slow item. It is read again, so that only those that are worked on are in memory.
    async fn finish(self: &Arc<Self>, index: usize) -> AppResult<GradeBody> {
        let batch = Arc::clone(self);
        let request = tokio::task::spawn_blocking(move || batch.read(index)).await;
        let request = request.map_err(|_panic| panicked())??;
        let prepared = request.prepare_in_turn(&self.state, &self.who).await;
        let prepared = prepared.map_err(AppError::without_reward_where_ours)?;
        let _permit = self.grading.acquire().await.expect("the semaphore is never closed");
        prepared.grade_in_turn(&self.state, &self.who).await
    }

    fn item(&self, index: usize, graded: AppResult<GradeBody>) -> BatchItem {
        match graded {
            Ok(result) => {
                BatchItem { index, status: 200, reward: Some(result.reward), result: Some(result), error: None }
            }
            Err(error) => self.failed(index, Problem::from(error)),
        }
    }

    fn failed(&self, index: usize, mut problem: Problem) -> BatchItem {
        for fault in &mut problem.faults {
            fault.line = self.items[index].line;
        }
        BatchItem { index, status: problem.status, reward: None, result: None, error: Some(problem) }
    }
}

fn panicked() -> AppError {
    AppError::internal(&"a log of a batch panicked").without_reward()
}

fn write_line(lines: &mut Vec<u8>, item: &BatchItem) {
    serde_json::to_writer(&mut *lines, item).expect("memory can be written, and an item is plain data");
    lines.push(b'\n');
}

/// A response body of chunks, sent as they arrive.
struct Chunks(mpsc::Receiver<Bytes>);

impl HttpBody for Chunks {
    type Data = Bytes;
    type Error = std::convert::Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        self.0.poll_recv(context).map(|chunk| chunk.map(|chunk| Ok(Frame::data(chunk))))
    }
}
