//! Reading request bodies: bounded one by one and all together.

use std::time::Duration;

use axum::body::Body;
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, StatusCode, header};
use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt as _;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::limits::LIMITS;
use super::problem::{ApiError, ApiResult};
use super::state::AppState;

/// Bytes that one permit of the shared budget stands for.
const PERMIT_BYTES: usize = 64 << 10;

/// The budget of memory for bodies.
#[must_use]
pub fn budget() -> Semaphore {
    Semaphore::new(LIMITS.bodies_in_memory_bytes / PERMIT_BYTES)
}

/// How a body is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// One JSON document.
    Json,
    /// One JSON document a line.
    NdJson,
}

/// A whole body, with its share of the budget.
#[derive(Debug)]
pub struct JsonBody {
    /// The bytes, decompressed.
    pub bytes: Bytes,
    /// How they are written.
    pub format: Format,
    _share: OwnedSemaphorePermit,
}

impl FromRequest<AppState> for JsonBody {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &AppState) -> ApiResult<Self> {
        let format = format(request.headers())?;
        // A compressed body has lost its length by now; it may unfold to the limit.
        let declared = content_length(request.headers());
        if declared.is_some_and(|length| length > LIMITS.body_bytes) {
            // A client that waits for leave to send has none to lose.
            if !request.headers().contains_key(header::EXPECT) {
                drain(request.into_body());
            }
            return Err(too_large());
        }
        let permits = declared.unwrap_or(LIMITS.body_bytes).div_ceil(PERMIT_BYTES).max(1);
        let permits = u32::try_from(permits).unwrap_or(u32::MAX);
        let share = state.bodies.clone().try_acquire_many_owned(permits).map_err(|_| {
            let detail = "Too many large bodies are being read. The request may be sent again.";
            ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "busy", "Busy", detail).retry_after(1)
        })?;
        let bytes = read(request.into_body(), declared.unwrap_or(0)).await?;
        Ok(Self { bytes, format, _share: share })
    }
}

fn too_large() -> ApiError {
    let detail = format!("the body is larger than {} bytes (after decompression)", LIMITS.body_bytes);
    ApiError::new(StatusCode::PAYLOAD_TOO_LARGE, "body-too-large", "The body is too large", detail)
}

async fn read(mut body: Body, expected: usize) -> ApiResult<Bytes> {
    let mut bytes = BytesMut::with_capacity(expected.min(LIMITS.body_bytes));
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| {
            let detail = format!("reading the body failed: {error}");
            ApiError::new(StatusCode::BAD_REQUEST, "unreadable-body", "The body could not be read", detail)
        })?;
        let Ok(data) = frame.into_data() else { continue };
        if bytes.len() + data.len() > LIMITS.body_bytes {
            drain(body);
            return Err(too_large());
        }
        bytes.extend_from_slice(&data);
    }
    Ok(bytes.freeze())
}

/// Reads on and throws away what a client still sends of a refused body, beside the answer: most clients read an
/// answer only when they have sent all, and would see a broken connection instead of the reason.
fn drain(mut body: Body) {
    const MAX_SECONDS: u64 = 30;
    const MAX_AT_ONCE: usize = 64;
    static DRAINS: Semaphore = Semaphore::const_new(MAX_AT_ONCE);
    let Ok(slot) = DRAINS.try_acquire() else { return };
    tokio::spawn(async move {
        let rest = async { while let Some(Ok(_)) = body.frame().await {} };
        // Either all was sent or the time is over: the connection is closed now.
        let _ = tokio::time::timeout(Duration::from_secs(MAX_SECONDS), rest).await;
        drop(slot);
    });
}

fn content_length(headers: &HeaderMap) -> Option<usize> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

/// JSON where the type is JSON or missing; NDJSON by any of its names; 415 else.
fn format(headers: &HeaderMap) -> ApiResult<Format> {
    let Some(value) = headers.get(header::CONTENT_TYPE) else { return Ok(Format::Json) };
    let text = value.to_str().unwrap_or_default();
    let essence = text.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    match essence.as_str() {
        "application/json" => Ok(Format::Json),
        "application/x-ndjson" | "application/ndjson" | "application/jsonl" | "application/json-lines" => {
            Ok(Format::NdJson)
        }
        "application/x-www-form-urlencoded" => {
            Err(unsupported("the body is sent as a form; with curl, add -H 'Content-Type: application/json'"))
        }
        other => {
            Err(unsupported(&format!("{other:?} is not supported; send application/json or application/x-ndjson")))
        }
    }
}

fn unsupported(detail: &str) -> ApiError {
    ApiError::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-media-type", "Unsupported media type", detail)
}
