//! The page of search results.

use askama::Template;
use axum::extract::{RawQuery, State};
use axum::response::{IntoResponse as _, Redirect};
use serde::Deserialize;

use super::html::{self, PageResult};
use crate::app::search::{Found, search};
use crate::http::extract::params;
use crate::http::state::AppState;

/// Query of a search.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SearchQuery {
    /// Text to find.
    #[serde(default)]
    text: String,
}

#[derive(Template)]
#[template(path = "search.html")]
struct SearchPage {
    text: String,
    found: Found,
}

impl SearchPage {
    const fn is_empty(&self) -> bool {
        let Found { agents, tasks, suites, epochs, page: _ } = &self.found;
        agents.1 + tasks.1 + suites.1 + epochs.1 == 0
    }
}

/// Serves what a search finds; redirects to a run or a submission that is searched by its identifier.
///
/// # Errors
/// Returns a 400 error if a parameter is unknown.
pub async fn page(State(state): State<AppState>, RawQuery(raw): RawQuery) -> PageResult {
    let SearchQuery { text } = params::read(&html::set_fields(raw.as_deref()))?;
    let found = search(&state, &text).await?;
    if let Some(page) = &found.page {
        return Ok(Redirect::to(page).into_response());
    }
    html::page(&SearchPage { text, found })
}
