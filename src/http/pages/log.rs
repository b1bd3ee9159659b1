//! The moderation log of a board: what was done to its rows, by whom and why.

use askama::Template;
use axum::extract::{Path, State};

use super::html::{self, PageResult};
use crate::app::boards::actions::past;
use crate::app::boards::read;
use crate::clock::rfc3339;
use crate::http::state::AppState;

/// Greatest number of entries on the page; the API lists all.
const MAX_ENTRIES: usize = 200;

/// Something that was done to a row.
struct Entry {
    at: String,
    run: String,
    agent: String,
    what: String,
    actor: String,
    reason: String,
}

#[derive(Template)]
#[template(path = "log.html")]
struct LogPage {
    suite: String,
    all: usize,
    entries: Vec<Entry>,
}

/// Serves the moderation log of a board, latest first.
///
/// # Errors
/// Returns a 404 error if the suite does not exist.
pub async fn page(State(state): State<AppState>, Path(suite): Path<String>) -> PageResult {
    let board = read::board(&state, &suite).await?;
    let entries = board.actions.iter().rev().take(MAX_ENTRIES).map(|action| Entry {
        at: rfc3339(action.at_ms),
        run: action.run_id.clone(),
        agent: board.shown_name(&action.run_id).unwrap_or("a run").to_owned(),
        what: past(&action.action).to_owned(),
        actor: action.actor.clone(),
        reason: action.reason.clone(),
    });
    html::page(&LogPage { suite: board.entry.id.clone(), all: board.actions.len(), entries: entries.collect() })
}
