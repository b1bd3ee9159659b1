//! Web pages, rendered on the server. They load nothing from other hosts. Scripts only add the 3D view and running
//! countdowns.

pub mod assets;
mod board;
mod claims;
mod epochs;
mod findings;
mod html;
mod run;
mod submission;
mod task;

use askama::Template;
use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::routing::get;

use super::boards::body::BoardBody;
use super::state::AppState;
use crate::app::access::Openness;
use crate::app::boards::leaderboard::best_of_all;
use html::PageResult;

/// Number of rows of each board on the home page.
const ROWS: u32 = 10;

/// Returns the routes of the pages.
pub fn routes() -> Router<AppState> {
    Router::new()
        .route("/", get(home))
        .route("/assets/{name}", get(assets::get))
        .route("/boards/{suite}", get(board::board))
        .route("/boards/{suite}/compare", get(board::compare_runs))
        .route("/runs/{id}", get(run::run))
        .route("/runs/{id}/tasks/{number}", get(run::task_of_run))
        .route("/submissions/{id}", get(submission::submission))
        .route("/submissions/{id}/view.svg", get(submission::picture))
        .route("/submissions/{id}/evidence.html", get(submission::evidence))
        .route("/epochs", get(epochs::epochs))
        .route("/epochs/{id}", get(epochs::epoch))
        .route("/compare", get(submission::beside))
        .route("/suites/{suite}/tasks", get(task::tasks))
        .route("/suites/{suite}/tasks/{number}", get(task::task))
        .route("/suites/{suite}/tasks/{number}/view.svg", get(task::picture))
}

#[derive(Template)]
#[template(path = "home.html")]
struct Home {
    boards: Vec<BoardBody>,
    /// Host of the service, from the `Host` header of the request.
    host: String,
    is_open: bool,
}

/// Serves the home page: an introduction, the boards and how to submit.
async fn home(State(state): State<AppState>, headers: HeaderMap) -> PageResult {
    let named = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let host = named.unwrap_or("localhost:7586").to_owned();
    let boards = best_of_all(&state, ROWS).await?.into_iter().map(BoardBody::from).collect();
    html::page(&Home { boards, host, is_open: state.keys.open == Openness::Open })
}
