//! Web pages, rendered here; they need no network and no script.

use askama::Template;
use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;

use super::api::leaderboards::{BoardBody, BoardQuery, page};
use super::problem::{ApiError, ApiResult};
use super::state::AppState;

/// Routes of the pages.
pub fn routes() -> Router<AppState> {
    Router::new().route("/", get(home))
}

#[derive(Template)]
#[template(path = "home.html")]
struct Home {
    boards: Vec<BoardBody>,
    /// Where the service is, as the browser named it.
    host: String,
}

/// A share as a percentage; `n/a` where there is none.
fn percent(rate: Option<f64>) -> String {
    rate.map_or_else(|| "n/a".to_owned(), |rate| format!("{:.1} %", rate * 100.0))
}

/// What the service is, its boards, and how to submit.
async fn home(State(state): State<AppState>, headers: HeaderMap) -> ApiResult<Response> {
    let named = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let host = named.unwrap_or("localhost:8080").to_owned();
    let catalogue = state.store.catalogue();
    let mut entries: Vec<_> = catalogue.suites().to_vec();
    // What new runs take comes first.
    entries.sort_by_key(|entry| std::cmp::Reverse(entry.suite.version));
    let mut boards = Vec::new();
    for entry in entries {
        let board = state.boards.of(&state, &entry).await?;
        boards.push(page(&board, &BoardQuery::default())?);
    }
    let page = Home { boards, host }.render().map_err(|error| ApiError::internal(&error))?;
    let policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'";
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(policy)),
    ];
    Ok((headers, page).into_response())
}
