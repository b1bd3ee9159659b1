//! The transparency log as witnesses and monitors read it (C2SP tlog-tiles): a checkpoint, its key, and tiles.

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Serialize;
use serde_json::json;

use crate::app::error::{AppError, AppResult, Kind};
use crate::app::hidden::cosignatures::{self, Witnessed};
use crate::app::hidden::log;
use crate::app::limits::LIMITS;
use crate::clock::rfc3339;
use crate::http::state::AppState;

/// Returns the routes of the log. Their paths and formats are those of the specification, not of the API.
pub fn routes() -> Router<AppState> {
    Router::new()
        .route("/log/checkpoint", get(checkpoint))
        .route("/log/key", get(key))
        .route("/log/tile/{*path}", get(tile))
        .route("/log/witnesses", get(witnesses))
        .route("/log/cosigned", get(cosigned))
        .route("/log/cosignatures", post(take_cosignatures))
        .layer(DefaultBodyLimit::max(LIMITS.form_bytes))
}

/// A witness of the log.
#[derive(Debug, Serialize)]
struct WitnessBody {
    name: String,
    /// Key that verifies its cosignatures.
    key: String,
    /// Number of entries that it cosigned last; null if it has not yet.
    size: Option<i64>,
    /// Time of that cosignature.
    cosigned_at: Option<String>,
    /// The checkpoint with that cosignature, as a signed note.
    note: Option<String>,
}

/// Returns the witnesses that the operator knows, with what each cosigned last.
async fn witnesses(State(state): State<AppState>) -> AppResult<Response> {
    let body = |Witnessed { witness, latest }: Witnessed| WitnessBody {
        size: latest.as_ref().map(|row| row.size),
        note: latest.as_ref().map(|row| format!("{}{}\n", row.checkpoint, row.line)),
        cosigned_at: latest.map(|row| rfc3339(row.at_s.saturating_mul(1_000))),
        name: witness.name,
        key: witness.key,
    };
    let all: Vec<WitnessBody> = cosignatures::witnesses(&state).await?.into_iter().map(body).collect();
    Ok(Json(json!({ "witnesses": all })).into_response())
}

/// Returns the last checkpoint that witnesses have cosigned.
async fn cosigned(State(state): State<AppState>) -> AppResult<Response> {
    Ok(answer("text/plain; charset=utf-8", "no-cache", cosignatures::cosigned(&state).await?.into_bytes()))
}

/// Takes a checkpoint with cosignatures.
async fn take_cosignatures(State(state): State<AppState>, body: Result<Bytes, BytesRejection>) -> AppResult<Response> {
    let body = body.map_err(|rejection| match rejection.status() {
        StatusCode::PAYLOAD_TOO_LARGE => {
            AppError::new(Kind::BodyTooLarge, format!("the body has more than {} bytes", LIMITS.form_bytes))
        }
        _ => AppError::new(Kind::UnreadableBody, rejection.body_text()),
    })?;
    let text = std::str::from_utf8(&body);
    let note = text.map_err(|error| AppError::new(Kind::BadRequest, format!("the body is no text: {error}")))?;
    cosignatures::take(&state, note).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

async fn checkpoint(State(state): State<AppState>) -> AppResult<Response> {
    Ok(answer("text/plain; charset=utf-8", "no-cache", log::checkpoint(&state).await?.into_bytes()))
}

async fn key(State(state): State<AppState>) -> AppResult<Response> {
    let key = log::key(&state).await? + "\n";
    Ok(answer("text/plain; charset=utf-8", "no-cache", key.into_bytes()))
}

/// A tile never changes once it can be read.
async fn tile(State(state): State<AppState>, Path(path): Path<String>) -> AppResult<Response> {
    let bytes = log::tile(&state, &path).await?;
    Ok(answer("application/octet-stream", "public, max-age=31536000, immutable", bytes))
}

fn answer(kind: &'static str, kept: &'static str, bytes: Vec<u8>) -> Response {
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        (header::CACHE_CONTROL, HeaderValue::from_static(kept)),
    ];
    (headers, bytes).into_response()
}
