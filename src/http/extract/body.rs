//! Reads request bodies. The size of each body is limited, and so is the memory for all of them together.

use std::borrow::Cow;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{FromRequest, OptionalFromRequest, Request};
use axum::http::{HeaderMap, header};
use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt as _;
use hyper::body::Body as _;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::room::PERMIT_BYTES;
use crate::app::body::{self, read_body};
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;
use crate::app::submissions::posted::Format;
use crate::http::state::AppState;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::not_json::why_not_json;
use plumbline_engine::intake::surrogates::without_lone_surrogates;
use plumbline_engine::text::{did_you_mean, reworded};

/// Byte order mark that a UTF-8 text may begin with.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Creates the shared memory budget for request bodies.
#[must_use]
pub fn budget() -> Semaphore {
    Semaphore::new(LIMITS.bodies_in_memory_bytes / PERMIT_BYTES)
}

/// A complete request body, with its share of the memory budget.
#[derive(Debug)]
pub struct JsonBody {
    /// Bytes of the body, decompressed.
    pub bytes: Bytes,
    /// Format of the body.
    pub format: Format,
    /// Share of the budget; to be held while the bytes, or data parsed from them, are in memory.
    pub share: Option<OwnedSemaphorePermit>,
}

impl JsonBody {
    /// Returns whether the body is JSON's `null`, which stands for none where a body is optional.
    pub fn is_null(&self) -> bool {
        self.bytes.trim_ascii() == b"null"
    }
}

impl FromRequest<AppState> for JsonBody {
    type Rejection = AppError;

    async fn from_request(request: Request, state: &AppState) -> AppResult<Self> {
        let format = format(request.headers());
        let RawBody { bytes, share } = RawBody::read(request, state, format.as_ref().err().cloned()).await?;
        // Some editors write a byte order mark at the beginning of a file, which JSON does not allow.
        let bytes = if bytes.starts_with(BYTE_ORDER_MARK) { bytes.slice(BYTE_ORDER_MARK.len()..) } else { bytes };
        let bytes = match without_lone_surrogates(&bytes) {
            Cow::Borrowed(_) => bytes,
            Cow::Owned(read) => read.into(),
        };
        Ok(Self { bytes, format: format?, share })
    }
}

/// A complete request body of any type, with its share of the memory budget.
#[derive(Debug)]
pub struct RawBody {
    /// Bytes of the body, decompressed.
    pub bytes: Bytes,
    /// Share of the budget; to be held while the bytes, or data parsed from them, are in memory.
    pub share: Option<OwnedSemaphorePermit>,
}

impl FromRequest<AppState> for RawBody {
    type Rejection = AppError;

    async fn from_request(request: Request, state: &AppState) -> AppResult<Self> {
        Self::read(request, state, None).await
    }
}

impl RawBody {
    /// Reads the body, unless it is refused because of its headers.
    async fn read(request: Request, state: &AppState, refusal: Option<AppError>) -> AppResult<Self> {
        let (parts, body) = request.into_parts();
        // A client that sent `Expect: 100-continue` is not sending the body yet.
        let is_sending = !parts.headers.contains_key(header::EXPECT);
        let refuse = |body: Body, error: AppError| {
            if is_sending {
                drain(body);
            }
            Err(error)
        };
        if let Some(error) = refusal {
            return refuse(body, error);
        }
        // A compressed body no longer has a Content-Length here.
        if content_length(&parts.headers).is_some_and(|length| length > LIMITS.body_bytes) {
            return refuse(body, too_large());
        }
        let (bytes, share) = read(body, &state.bodies).await?;
        Ok(Self { bytes, share })
    }
}

impl OptionalFromRequest<AppState> for JsonBody {
    type Rejection = AppError;

    /// Returns `None` if the request has no body.
    async fn from_request(request: Request, state: &AppState) -> AppResult<Option<Self>> {
        // Asks the body and not the headers: a compressed body no longer has a Content-Length here.
        if request.body().is_end_stream() || request.body().size_hint().exact() == Some(0) {
            return Ok(None);
        }
        <Self as FromRequest<AppState>>::from_request(request, state).await.map(Some)
    }
}

/// Reads a body that `request_body!` declares, with the faults found so far, to which the use case adds its own. The
/// draft is `None` if the body is no object.
///
/// # Errors
/// Returns an error if the body is NDJSON (415), in which case `hint` says what to send instead, or is not JSON (400).
pub fn read_draft<B: body::Body>(body: &JsonBody, hint: &str) -> AppResult<(Option<B>, Faults)> {
    if body.format == Format::NdJson {
        return Err(AppError::not_ndjson(hint));
    }
    let mut faults = Faults::new();
    match read_body(&body.bytes, &mut faults) {
        Ok(draft) => Ok((draft, faults)),
        Err(error) => {
            faults.add(why_not_json(&body.bytes, &error));
            Err(AppError::malformed(faults))
        }
    }
}

/// Deserializes a body, collecting all faults with their locations.
///
/// # Errors
/// Returns an error if the body is NDJSON (415), is not JSON (400), or does not fit the type (422).
pub fn read_json<T: DeserializeOwned>(body: &JsonBody) -> AppResult<T> {
    if body.format == Format::NdJson {
        return Err(AppError::not_ndjson("send one document per request"));
    }
    // serde takes a list for the members of a struct, in their order.
    if body.bytes.trim_ascii_start().starts_with(b"[")
        && serde_json::from_slice::<serde::de::IgnoredAny>(&body.bytes).is_ok()
    {
        let mut faults = Faults::new();
        faults.add("expected an object, found an array");
        return Err(AppError::faulty(faults));
    }
    let mut document = serde_json::Deserializer::from_slice(&body.bytes);
    let read = serde_path_to_error::deserialize(&mut document);
    let mut faults = Faults::new();
    match read.map(|value| document.end().map(|()| value)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => {
            faults.add(why_not_json(&body.bytes, &error));
            Err(AppError::malformed(faults))
        }
        Err(error) if error.inner().is_data() => {
            // Collecting all faults reads the members several times.
            let is_small = body.bytes.len() <= LIMITS.all_faults_bytes;
            match is_small.then(|| serde_json::from_slice::<Value>(&body.bytes)) {
                Some(Ok(Value::Object(members))) => add_faults::<T>(&members, &error, &mut faults),
                _ => add_fault(&error, &mut faults),
            }
            Err(AppError::faulty(faults))
        }
        Err(error) => {
            faults.add(why_not_json(&body.bytes, error.inner()));
            Err(AppError::malformed(faults))
        }
    }
}

type DataError = serde_path_to_error::Error<serde_json::Error>;

/// Adds all faults of an object. Reads each member alone to find the wrong ones, and then reads the others together to
/// find the missing members one by one.
fn add_faults<T: DeserializeOwned>(members: &Map<String, Value>, first: &DataError, faults: &mut Faults) {
    let read =
        |members: &Map<String, Value>| serde_path_to_error::deserialize::<_, T>(Value::Object(members.clone())).err();
    let mut sound = members.clone();
    for (name, value) in members {
        let alone: Map<String, Value> = std::iter::once((name.clone(), value.clone())).collect();
        if let Some(error) = read(&alone).filter(|error| missing_of(error).is_none()) {
            add_fault(&error, faults);
            sound.remove(name);
        }
    }
    let mut rest = sound;
    // serde reports one missing member at a time: a placeholder is inserted for it, so that the next one is reported.
    let stand_ins = [Value::Null, json!(""), json!(1), json!(false), json!([]), json!({})];
    while let Some(name) = read(&rest).as_ref().and_then(missing_of) {
        if !members.contains_key(&name) {
            faults.add_at(&name, "missing");
        }
        let stands_in = |value: &&Value| {
            let mut with = rest.clone();
            with.insert(name.clone(), (*value).clone());
            read(&with).is_none_or(|error| missing_of(&error).is_some_and(|next| next != name))
        };
        let Some(value) = stand_ins.iter().find(stands_in) else { break };
        rest.insert(name.clone(), value.clone());
    }
    if faults.is_empty() {
        add_fault(first, faults);
    }
}

/// Returns the name of the top-level member that an error reports as missing.
fn missing_of(error: &DataError) -> Option<String> {
    let text = error.inner().to_string();
    let is_at_top = error.path().iter().next().is_none();
    text.strip_prefix("missing field `").filter(|_| is_at_top)?.split('`').next().map(str::to_owned)
}

fn add_fault(error: &DataError, faults: &mut Faults) {
    let depth = faults.enter_path(error.path());
    let text = error.inner().to_string();
    // The position in the text is meaningless for a value that was parsed before.
    let told = text.split(" at line ").next().unwrap_or(&text);
    let known: Vec<&str> = told.split('`').skip(3).step_by(2).collect();
    let name = told.split('`').nth(1).unwrap_or_default();
    if told.starts_with("unknown field") {
        // The path ends at the member itself if it is at the top level, and otherwise at the object that contains it.
        if error.path().iter().next_back().is_none_or(|last| last.to_string() != name) {
            faults.enter_key(name);
        }
        faults.add(format!("unknown field{}", did_you_mean(name, known.iter().copied())));
    } else if let Some(name) = told.strip_prefix("missing field `").map(|rest| rest.trim_end_matches('`')) {
        faults.add_at(name, "missing");
    } else if told.starts_with("unknown variant") {
        faults.add(format!("{name:?} is not one of {}{}", known.join(", "), did_you_mean(name, known.iter().copied())));
    } else {
        faults.add(reworded(told));
    }
    faults.leave_to(depth);
}

fn too_large() -> AppError {
    let detail = format!("the body is larger than {} bytes (after decompression)", LIMITS.body_bytes);
    AppError::new(Kind::BodyTooLarge, detail)
}

/// Reads a body to its end, taking permits from the budget as bytes arrive.
async fn read(mut body: Body, budget: &Arc<Semaphore>) -> AppResult<(Bytes, Option<OwnedSemaphorePermit>)> {
    let mut bytes = BytesMut::new();
    let mut share: Option<OwnedSemaphorePermit> = None;
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| {
            let detail = format!("reading the body failed: {error}");
            AppError::new(Kind::UnreadableBody, detail)
        })?;
        let Ok(data) = frame.into_data() else { continue };
        if bytes.len() + data.len() > LIMITS.body_bytes {
            drain(body);
            return Err(too_large());
        }
        bytes.extend_from_slice(&data);
        let held = share.as_ref().map_or(0, OwnedSemaphorePermit::num_permits);
        let wanted = (bytes.len() / PERMIT_BYTES).saturating_sub(held);
        if let Err(error) = grow(&mut share, budget, wanted) {
            drain(body);
            return Err(error);
        }
        // Decompression may never wait for the network, so this yields to other tasks explicitly.
        tokio::task::consume_budget().await;
    }
    Ok((bytes.freeze(), share))
}

/// Takes more permits from the budget.
fn grow(share: &mut Option<OwnedSemaphorePermit>, budget: &Arc<Semaphore>, permits: usize) -> AppResult<()> {
    if permits == 0 {
        return Ok(());
    }
    let more = u32::try_from(permits).ok().and_then(|n| Arc::clone(budget).try_acquire_many_owned(n).ok());
    let more = more.ok_or_else(busy)?;
    match share {
        Some(share) => share.merge(more),
        none => *none = Some(more),
    }
    Ok(())
}

fn busy() -> AppError {
    let detail = "too many large bodies are being read; send the request again in a moment";
    AppError::new(Kind::Busy, detail).retry_after(1)
}

/// Reads and discards the rest of a rejected body in the background. Most clients read the response only after sending
/// the whole body; without this they would see a broken connection instead of the reason.
fn drain(mut body: Body) {
    const MAX_SECONDS: u64 = 30;
    const MAX_BYTES: usize = 2 << 30;
    const MAX_AT_ONCE: usize = 64;
    static DRAINS: Semaphore = Semaphore::const_new(MAX_AT_ONCE);
    let Ok(slot) = DRAINS.try_acquire() else { return };
    tokio::spawn(async move {
        let rest = async {
            let mut left = MAX_BYTES;
            while let Some(Ok(frame)) = body.frame().await {
                left = left.saturating_sub(frame.data_ref().map_or(0, Bytes::len));
                if left == 0 {
                    break;
                }
                tokio::task::consume_budget().await;
            }
        };
        // Either the client has sent everything or a limit is reached; the connection is closed now.
        let _ = tokio::time::timeout(Duration::from_secs(MAX_SECONDS), rest).await;
        drop(slot);
    });
}

fn content_length(headers: &HeaderMap) -> Option<usize> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

/// Returns the format from Content-Type: JSON if it is JSON or missing, NDJSON for any of its media types, otherwise a
/// 415 error.
fn format(headers: &HeaderMap) -> AppResult<Format> {
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
        other => Err(unsupported(&format!(
            "{other:?} is not supported; send application/json, or application/x-ndjson where a body may have many lines"
        ))),
    }
}

fn unsupported(detail: &str) -> AppError {
    AppError::new(Kind::UnsupportedMediaType, detail)
}
