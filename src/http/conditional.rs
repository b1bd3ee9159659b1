//! Conditional requests: what the client already has (RFC 9110, section 13).

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
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

/// A JSON document under an entity tag made from its bytes.
#[derive(Debug)]
pub struct Tagged {
    bytes: Bytes,
    tag: HeaderValue,
}

impl Tagged {
    /// Writes the document.
    ///
    /// # Errors
    /// 500 where it cannot be written as JSON.
    pub fn of(document: &impl Serialize) -> ApiResult<Self> {
        let bytes = serde_json::to_vec(document).map_err(|error| ApiError::internal(&error))?;
        let tag = format!("\"{}\"", &hex(&Sha256::digest(&bytes))[..32]);
        let tag = HeaderValue::from_str(&tag).map_err(|error| ApiError::internal(&error))?;
        Ok(Self { bytes: bytes.into(), tag })
    }

    /// The document, or 304 where the client has it.
    #[must_use]
    pub fn answer(&self, asked: &HeaderMap) -> Response {
        let tag = [(header::ETAG, self.tag.clone())];
        if has_tag(asked, self.tag.to_str().unwrap_or_default()) {
            return (StatusCode::NOT_MODIFIED, tag).into_response();
        }
        (tag, [(header::CONTENT_TYPE, "application/json")], Body::from(self.bytes.clone())).into_response()
    }
}

/// A JSON document under an entity tag, or 304 where the client has it.
///
/// # Errors
/// 500 where it cannot be written as JSON.
pub fn tagged_json(asked: &HeaderMap, document: &impl Serialize) -> ApiResult<Response> {
    Ok(Tagged::of(document)?.answer(asked))
}
