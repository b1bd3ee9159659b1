//! The transparency log as witnesses and monitors read it (C2SP tlog-tiles): a checkpoint, its key, and tiles.

use axum::Router;
use axum::extract::{Path, State};
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;

use crate::app::error::AppResult;
use crate::app::hidden::log;
use crate::http::state::AppState;

/// Returns the routes of the log. Their paths and formats are those of the specification, not of the API.
pub fn routes() -> Router<AppState> {
    Router::new()
        .route("/log/checkpoint", get(checkpoint))
        .route("/log/key", get(key))
        .route("/log/tile/{*path}", get(tile))
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
