//! Conditional requests: what the client already has (RFC 9110, section 13), and documents that are kept.

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

/// Bytes of documents that are kept.
const KEPT_BYTES: u64 = 32 << 20;
/// Bytes of a document, about, to begin with.
const TYPICAL_BYTES: u64 = 16 << 10;

/// Whether `If-None-Match` names this entity tag, or any. Weak and strong tags match.
#[must_use]
pub fn has_tag(headers: &HeaderMap, tag: &str) -> bool {
    let known = headers.get(header::IF_NONE_MATCH).and_then(|tags| tags.to_str().ok()).unwrap_or_default();
    known.split(',').any(|known| known.trim() == "*" || strong(known) == strong(tag))
}

fn strong(tag: &str) -> &str {
    tag.trim().trim_start_matches("W/")
}

/// A strong entity tag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tag(String);

impl Tag {
    /// The tag of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        Self(format!("\"{}\"", &hex(&Sha256::digest(bytes))[..32]))
    }

    /// The tag of what has this name, which must name all that its bytes depend on.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self::of(name.as_bytes())
    }

    fn header(&self) -> AppResult<HeaderValue> {
        HeaderValue::from_str(&self.0).map_err(|error| AppError::internal(&error))
    }
}

/// A document.
#[derive(Debug, Clone)]
pub struct Document {
    /// Its media type.
    pub kind: &'static str,
    /// Its bytes.
    pub bytes: Bytes,
}

impl Document {
    /// As JSON.
    ///
    /// # Errors
    /// 500 where it cannot be written.
    pub fn json(document: &impl Serialize) -> AppResult<Self> {
        let bytes = serde_json::to_vec(document).map_err(|error| AppError::internal(&error))?;
        Ok(Self { kind: "application/json", bytes: bytes.into() })
    }

    /// The document, or 304 where the client has it.
    ///
    /// # Errors
    /// 500 where the tag is none.
    pub fn answer(&self, asked: &HeaderMap, tag: &Tag) -> AppResult<Response> {
        let header = [(header::ETAG, tag.header()?)];
        if has_tag(asked, &tag.0) {
            return Ok((StatusCode::NOT_MODIFIED, header).into_response());
        }
        let kind = [(header::CONTENT_TYPE, HeaderValue::from_static(self.kind))];
        Ok((header, kind, Body::from(self.bytes.clone())).into_response())
    }
}

/// A JSON document under an entity tag made from its bytes, or 304 where the client has it.
///
/// # Errors
/// 500 where it cannot be written as JSON.
pub fn tagged_json(asked: &HeaderMap, document: &impl Serialize) -> AppResult<Response> {
    let document = Document::json(document)?;
    let tag = Tag::of(&document.bytes);
    document.answer(asked, &tag)
}

#[derive(Debug, Clone)]
struct ByBytes;

impl Weighter<String, (Document, Tag)> for ByBytes {
    fn weight(&self, name: &String, (document, _): &(Document, Tag)) -> u64 {
        (name.len() + document.bytes.len()) as u64
    }
}

/// Documents that were made, by names that name all that their bytes depend on.
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
    /// The document of this name, made where it is not kept, or 304 where the client has it.
    ///
    /// # Errors
    /// What making it comes to.
    pub fn answer(
        &self,
        asked: &HeaderMap,
        name: String,
        make: impl FnOnce() -> AppResult<Document>,
    ) -> AppResult<Response> {
        if let Some((document, tag)) = self.kept.get(&name) {
            return document.answer(asked, &tag);
        }
        // Need not be made to be compared.
        let tag = Tag::named(&name);
        let is_any = asked.get(header::IF_NONE_MATCH).is_some_and(|known| known == "*");
        if !is_any && has_tag(asked, &tag.0) {
            return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, tag.header()?)]).into_response());
        }
        let document = make()?;
        self.kept.insert(name, (document.clone(), tag.clone()));
        document.answer(asked, &tag)
    }
}
