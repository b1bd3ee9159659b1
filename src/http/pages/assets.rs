//! Static assets of the pages, embedded in the binary. Pages append their version to asset URLs.

use std::sync::LazyLock;

use axum::extract::{Path, RawQuery};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use sha2::{Digest as _, Sha256};

use crate::app::error::{AppError, AppResult};
use crate::http::extract::conditional::{Document, Tag};
use plumbline_engine::tasks::hex;

/// Stylesheet of all pages.
pub const STYLE: &str = include_str!("assets/style.css");
/// Script of the 3D view.
pub const VIEWER: &str = include_str!("assets/viewer.js");
/// Script of all pages: countdowns, buttons that copy, and pages of what is under way.
pub const PAGE: &str = include_str!("assets/page.js");
/// Icon of all pages.
pub const ICON: &str = include_str!("assets/icon.svg");
/// Length of the version, in characters.
const VERSION_CHARS: usize = 16;

/// Returns the version of the assets, which changes with their content. Pages append it to asset URLs, so that browsers
/// load new assets after an upgrade.
#[must_use]
pub fn version() -> &'static str {
    static VERSION: LazyLock<String> = LazyLock::new(|| {
        let mut version = hex(&Sha256::digest([STYLE, VIEWER, PAGE, ICON].concat()));
        version.truncate(VERSION_CHARS);
        version
    });
    &VERSION
}

/// Serves an asset. Only under a URL with its version may it be kept without asking again.
///
/// # Errors
/// Returns a 404 error if no asset has this name.
pub async fn get(Path(name): Path<String>, RawQuery(query): RawQuery, asked: HeaderMap) -> AppResult<Response> {
    let (kind, text) = match name.as_str() {
        "style.css" => ("text/css; charset=utf-8", STYLE),
        "page.js" => ("text/javascript; charset=utf-8", PAGE),
        "icon.svg" => ("image/svg+xml", ICON),
        "viewer.js" => ("text/javascript; charset=utf-8", VIEWER),
        _ => return Err(AppError::not_found(format!("there is no asset {name:?}"))),
    };
    let document = Document { kind, bytes: text.into() };
    let mut response = document.answer(&asked, &Tag::of(text.as_bytes()));
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static(kept_for(query.as_deref())));
    Ok(response)
}

fn kept_for(query: Option<&str>) -> &'static str {
    if query == Some(version()) { "public, max-age=31536000, immutable" } else { "public, no-cache" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_url_with_the_version_is_kept_without_asking() {
        assert!(kept_for(Some(version())).contains("immutable"));
        for other in [None, Some(""), Some("0.1.0")] {
            assert_eq!(kept_for(other), "public, no-cache");
        }
    }
}
