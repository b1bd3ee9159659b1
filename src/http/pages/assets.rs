//! Files that pages ask for: in the binary, under an address that changes with the program.

use axum::extract::Path;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse as _, Response};

use crate::app::error::{AppError, AppResult};

/// The sheet of all pages.
pub const STYLE: &str = include_str!("assets/style.css");
/// The 3D view.
pub const VIEWER: &str = include_str!("assets/viewer.js");
/// Clocks that run.
pub const COUNTDOWN: &str = include_str!("assets/countdown.js");
/// Part of the addresses of assets, so that browsers may keep them for long.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// An asset.
///
/// # Errors
/// 404 where there is none of this name.
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
