//! Conditional requests: what the client already has (RFC 9110, section 13).

use axum::http::{HeaderMap, header};

/// Whether `If-None-Match` names this entity tag, or any. Weak and strong tags match.
#[must_use]
pub fn has_tag(headers: &HeaderMap, tag: &str) -> bool {
    let known = headers.get(header::IF_NONE_MATCH).and_then(|tags| tags.to_str().ok()).unwrap_or_default();
    known.split(',').any(|known| known.trim() == "*" || strong(known) == strong(tag))
}

fn strong(tag: &str) -> &str {
    tag.trim().trim_start_matches("W/")
}
