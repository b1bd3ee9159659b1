//! Conditional requests: what the client already has (RFC 9110, section 13).

use axum::body::Body;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use sha2::{Digest as _, Sha256};

use super::problem::{ApiError, ApiResult};
use crate::tasks::hex;

/// Whether `If-None-Match` names this entity tag, or any. Weak and strong tags match.
#[must_use]
pub fn has_tag(headers: &HeaderMap, tag: &str) -> bool {
    let known = headers.get(header::IF_NONE_MATCH).and_then(|tags| tags.to_str().ok()).unwrap_or_default();
    known.split(',').any(|known| known.trim() == "*" || strong(known) == strong(tag))
}

fn strong(tag: &str) -> &str {
    tag.trim().trim_start_matches("W/")
}

/// A JSON body under an entity tag made from its bytes, or 304 where the client has it.
///
/// # Errors
/// 500 where the body cannot be written as JSON.
pub fn tagged_json(headers: &HeaderMap, body: &impl Serialize) -> ApiResult<Response> {
    let bytes = serde_json::to_vec(body).map_err(|error| ApiError::internal(&error))?;
    let tag = format!("\"{}\"", &hex(&Sha256::digest(&bytes))[..32]);
    let tag_header = [(header::ETAG, tag.clone())];
    if has_tag(headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, tag_header).into_response());
    }
    Ok((tag_header, [(header::CONTENT_TYPE, "application/json")], Body::from(bytes)).into_response())
}
