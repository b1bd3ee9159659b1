//! Static assets of the pages, embedded in the binary. Pages append the program version to asset URLs.

use axum::extract::Path;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse as _, Response};

use crate::app::error::{AppError, AppResult};

/// Stylesheet of all pages.
pub const STYLE: &str = include_str!("assets/style.css");
/// Script of the 3D view.
pub const VIEWER: &str = include_str!("assets/viewer.js");
/// Script that keeps countdowns running.
pub const COUNTDOWN: &str = include_str!("assets/countdown.js");
/// Program version, which pages append to asset URLs so that browsers load new assets after an upgrade.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Serves an asset.
///
/// # Errors
/// Returns a 404 error if no asset has this name.
pub async fn get(Path(name): Path<String>) -> AppResult<Response> {
    let (kind, text) = match name.as_str() {
        "style.css" => ("text/css; charset=utf-8", STYLE),
        "countdown.js" => ("text/javascript; charset=utf-8", COUNTDOWN),
        "viewer.js" => ("text/javascript; charset=utf-8", VIEWER),
        _ => return Err(AppError::not_found(format!("there is no asset {name:?}"))),
    };
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        (header::CACHE_CONTROL, HeaderValue::from_static("public, max-age=3600")),
    ];
    Ok((headers, text).into_response())
}
