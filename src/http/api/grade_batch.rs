//! Grading many logs in one request: results stream back as they are ready, each with its own status.

use std::ops::Range;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};

use axum::body::{Body, HttpBody};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use hyper::body::Frame;
use serde::Serialize;
use serde_json::value::RawValue;
use tokio::runtime::Handle;
use tokio::sync::mpsc;

use super::super::body::{Format, JsonBody};
use super::super::caller::Caller;
use super::super::limits::LIMITS;
use super::super::problem::{ApiError, ApiResult, Problem};
use super::super::state::AppState;
use super::grade::{GradeBody, NewGrade};
use super::grade_request::ReadRequest;
use crate::store::keys::Scope;
use crate::tasks::catalogue::Catalogue;
use crate::voxel::Faults;

/// Logs that a thread takes at a time, and answers together.
const CHUNK: usize = 16;
/// Chunks of answers that wait for a slow client.
const WAITING: usize = 64;

/// The result of one log of a batch.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BatchItem {
    /// Place of the log in the request, from 0.
    pub index: usize,
    /// The HTTP status that the log would have had alone.
    #[schema(minimum = 200, maximum = 599, example = 200)]
    pub status: u16,
    /// The reward; null where there is none.
    #[schema(minimum = 0, maximum = 1)]
    pub reward: Option<f64>,
    /// Scores, where it was graded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub result: Option<GradeBody>,
    /// Why it was not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
}

/// Grade many logs: NDJSON, one request a line, or a JSON array of them. The answer is NDJSON, a line a log as soon as it is
/// graded, in any order; `index` tells which. A log that fails does not touch the others.
#[utoipa::path(
    post, path = "/v1/grade:batch", operation_id = "grade_batch", tag = "rewards", summary = "Grade many logs at once",
    request_body(content((Vec<NewGrade> = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 200, description = "A line a log: `BatchItem`", body = String, content_type = "application/x-ndjson",
         example = "{\"index\":0,\"status\":200,\"reward\":1.0}\n"),
        (status = 400, description = "Not JSON as a whole", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Neither JSON nor NDJSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Too many logs", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much to do; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn grade_batch(State(state): State<AppState>, caller: Caller, body: JsonBody) -> ApiResult<Response> {
    caller.require(Scope::Grade)?;
    let place = state.grader.admit_batch()?;
    let JsonBody { bytes, format, share } = body;
    let catalogue = state.store.current_catalogue().await?;
    let splitting = tokio::task::spawn_blocking(move || split(&bytes, format).map(|items| (bytes, items)));
    let (bytes, items) = splitting.await.map_err(|error| ApiError::internal(&error))??;
    let (sender, receiver) = mpsc::channel(WAITING);
    let batch =
        Arc::new(Batch { state, catalogue, bytes, items, next: AtomicUsize::new(0), runtime: Handle::current() });
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let held = Arc::new((place, share));
    for _ in 0..cores.min(batch.items.len().div_ceil(CHUNK)) {
        let (batch, sender, held) = (Arc::clone(&batch), sender.clone(), Arc::clone(&held));
        tokio::task::spawn_blocking(move || {
            let _held = held;
            batch.work(&sender);
        });
    }
    let kind = [(header::CONTENT_TYPE, "application/x-ndjson")];
    Ok((kind, Body::new(Chunks(receiver))).into_response())
}

/// Where each item lies in the body.
fn split(bytes: &Bytes, format: Format) -> ApiResult<Vec<Range<usize>>> {
    let mut items = Vec::new();
    let range_of = |part: &[u8]| {
        let start = part.as_ptr() as usize - bytes.as_ptr() as usize;
        start..start + part.len()
    };
    match format {
        Format::NdJson => {
            let lines = bytes.split(|byte| *byte == b'\n');
            items.extend(lines.filter(|line| !line.iter().all(u8::is_ascii_whitespace)).map(range_of));
        }
        Format::Json => {
            let parts: Vec<&RawValue> = serde_json::from_slice(bytes).map_err(|error| {
                let mut faults = Faults::new();
                faults.add(format!(
                    "expected a list of requests ({error}); a request a line is sent as application/x-ndjson"
                ));
                ApiError::malformed(faults)
            })?;
            items.extend(parts.into_iter().map(|part| range_of(part.get().as_bytes())));
        }
    }
    if items.is_empty() || items.len() > LIMITS.grade_batch_logs {
        let mut faults = Faults::new();
        faults.add(format!("{} logs; expected 1 to {}", items.len(), LIMITS.grade_batch_logs));
        return Err(ApiError::faulty(faults));
    }
    Ok(items)
}

struct Batch {
    state: AppState,
    catalogue: Arc<Catalogue>,
    bytes: Bytes,
    items: Vec<Range<usize>>,
    next: AtomicUsize,
    runtime: Handle,
}

impl Batch {
    /// Grades chunk after chunk until none is left or the client has gone.
    fn work(&self, sender: &mpsc::Sender<Bytes>) {
        loop {
            let first = self.next.fetch_add(CHUNK, Ordering::Relaxed);
            if first >= self.items.len() {
                return;
            }
            let mut lines = Vec::new();
            for index in first..(first + CHUNK).min(self.items.len()) {
                let item = self.grade(index);
                // Writing to memory does not fail, and an item is plain data.
                let _ = serde_json::to_writer(&mut lines, &item);
                lines.push(b'\n');
            }
            if sender.blocking_send(lines.into()).is_err() {
                return;
            }
        }
    }

    fn grade(&self, index: usize) -> BatchItem {
        let text = &self.bytes[self.items[index].clone()];
        let graded = ReadRequest::read(text, &self.catalogue).and_then(|request| {
            let prepared = self.runtime.block_on(request.prepare(&self.state));
            prepared.map_err(ApiError::without_reward_where_ours)?.grade_here(&self.state)
        });
        match graded {
            Ok(result) => {
                BatchItem { index, status: 200, reward: Some(result.reward), result: Some(result), error: None }
            }
            Err(error) => {
                let problem = error.into_problem();
                BatchItem { index, status: problem.status, reward: None, result: None, error: Some(problem) }
            }
        }
    }
}

/// A body of chunks as they come.
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
