//! Conditional requests (RFC 9110, section 13), and a cache of documents.

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use serde::Serialize;
use sha2::{Digest as _, Sha256};

use crate::app::error::{AppError, AppResult};
use plumbline_engine::tasks::hex;

/// Capacity of the document cache, in bytes.
const KEPT_BYTES: u64 = 32 << 20;
/// Typical size of a document in bytes, from which the initial number of cache slots is estimated.
const TYPICAL_BYTES: u64 = 16 << 10;
/// Typical number of headers of a response with a document, including those that the middleware adds.
const TYPICAL_HEADERS: usize = 12;

/// Returns whether `If-None-Match` contains this entity tag or `*`. Weak and strong tags match each other.
#[must_use]
pub fn has_tag(headers: &HeaderMap, tag: &str) -> bool {
    let Some(known) = headers.get(header::IF_NONE_MATCH).and_then(|tags| tags.to_str().ok()) else { return false };
    known.split(',').any(|known| known.trim() == "*" || strong(known) == strong(tag))
}

fn strong(tag: &str) -> &str {
    tag.trim().trim_start_matches("W/")
}

/// A strong entity tag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tag(HeaderValue);

impl Tag {
    /// Computes the tag of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let digest = &hex(&Sha256::digest(bytes))[..32];
        Self(HeaderValue::try_from(format!("\"{digest}\"")).expect("hexadecimal digits are valid in a header value"))
    }

    /// Computes the tag of a document from its name, which must contain everything that the bytes depend on.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self::of(name.as_bytes())
    }

    /// Returns whether `If-None-Match` contains this tag or `*`.
    fn is_known(&self, asked: &HeaderMap) -> bool {
        self.0.to_str().is_ok_and(|tag| has_tag(asked, tag))
    }

    fn not_modified(&self) -> Response {
        (StatusCode::NOT_MODIFIED, [(header::ETAG, self.0.clone())]).into_response()
    }
}

/// A serialized document.
#[derive(Debug, Clone)]
pub struct Document {
    /// Media type of the document.
    pub kind: &'static str,
    /// Bytes of the document.
    pub bytes: Bytes,
}

impl Document {
    /// Serializes a document as JSON.
    ///
    /// # Errors
    /// Returns an error (500) if it cannot be serialized.
    pub fn json(document: &impl Serialize) -> AppResult<Self> {
        let bytes = serde_json::to_vec(document).map_err(|error| AppError::internal(&error))?;
        Ok(Self { kind: "application/json", bytes: bytes.into() })
    }

    /// Responds with the document, or with 304 if the client has it.
    #[must_use]
    pub fn answer(&self, asked: &HeaderMap, tag: &Tag) -> Response {
        if tag.is_known(asked) {
            return tag.not_modified();
        }
        let mut response = Response::new(Body::from(self.bytes.clone()));
        let headers = response.headers_mut();
        headers.reserve(TYPICAL_HEADERS);
        headers.insert(header::ETAG, tag.0.clone());
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(self.kind));
        response
    }
}

/// Responds with a JSON document and an entity tag computed from its bytes, or with 304 if the client has it.
///
/// # Errors
/// Returns an error (500) if the document cannot be serialized as JSON.
pub fn tagged_json(asked: &HeaderMap, document: &impl Serialize) -> AppResult<Response> {
    let document = Document::json(document)?;
    let tag = Tag::of(&document.bytes);
    Ok(document.answer(asked, &tag))
}

#[derive(Debug, Clone)]
struct ByBytes;

impl Weighter<String, (Document, Tag)> for ByBytes {
    fn weight(&self, name: &String, (document, _): &(Document, Tag)) -> u64 {
        (name.len() + document.bytes.len()) as u64
    }
}

/// Cache of documents by name; a name must contain everything that the bytes depend on.
#[derive(Debug)]
pub struct Documents {
    kept: Cache<String, (Document, Tag), ByBytes>,
}

impl Default for Documents {
    fn default() -> Self {
        Self { kept: Cache::with_weighter((KEPT_BYTES / TYPICAL_BYTES) as usize, KEPT_BYTES, ByBytes) }
    }
}

impl Documents {
    /// Responds with the document of this name, created by `make` if it is not cached, or with 304 if the client has
    /// it.
    ///
    /// # Errors
    /// Returns the error of `make`.
    pub fn answer(
        &self,
        asked: &HeaderMap,
        name: String,
        make: impl FnOnce() -> AppResult<Document>,
    ) -> AppResult<Response> {
        match self.known(asked, &name) {
            Some(response) => Ok(response),
            None => Ok(self.keep(asked, name, &make()?)),
        }
    }

    /// Responds with the document of this name if it is cached, or with 304 if the client has it.
    #[must_use]
    pub fn known(&self, asked: &HeaderMap, name: &str) -> Option<Response> {
        if let Some((document, tag)) = self.kept.get(name) {
            return Some(document.answer(asked, &tag));
        }
        // The tag depends on the name alone, so the document is not needed for the comparison.
        let is_any = asked.get(header::IF_NONE_MATCH).is_some_and(|known| known == "*");
        let tag = Tag::named(name);
        (!is_any && tag.is_known(asked)).then(|| tag.not_modified())
    }

    /// Caches a document under its name, and responds with it.
    #[must_use]
    pub fn keep(&self, asked: &HeaderMap, name: String, document: &Document) -> Response {
        let tag = Tag::named(&name);
        self.kept.insert(name, (document.clone(), tag.clone()));
        document.answer(asked, &tag)
    }
}
