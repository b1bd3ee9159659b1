//! Web pages, rendered on the server. They load nothing from other hosts. Scripts only add the 3D view and running
//! countdowns.

pub mod assets;
mod board;
mod claims;
mod epochs;
mod findings;
mod home;
mod html;
mod lines;
mod run;
mod submission;
mod task;
pub mod thumbnails;

use axum::Router;
use axum::routing::get;

use super::state::AppState;

/// Returns the routes of the pages.
pub fn routes() -> Router<AppState> {
    Router::new()
        .route("/", get(home::home))
        .route("/assets/{name}", get(assets::get))
        .route("/boards/{suite}", get(board::board))
        .route("/boards/{suite}/compare", get(board::compare_runs))
        .route("/runs/{id}", get(run::run))
        .route("/runs/{id}/tasks/{number}", get(run::task_of_run))
        .route("/runs/{id}/tasks/{number}/thumbnail.png", get(thumbnails::of_run))
        .route("/submissions/{id}", get(submission::submission))
        .route("/submissions/{id}/view.svg", get(submission::picture))
        .route("/submissions/{id}/thumbnail.png", get(thumbnails::of_submission))
        .route("/submissions/{id}/evidence.html", get(submission::evidence))
        .route("/epochs", get(epochs::epochs))
        .route("/epochs/{id}", get(epochs::epoch))
        .route("/compare", get(submission::beside))
        .route("/suites/{suite}/tasks", get(task::tasks))
        .route("/suites/{suite}/tasks/{number}", get(task::task))
        .route("/suites/{suite}/tasks/{number}/view.svg", get(task::picture))
        .route("/suites/{suite}/tasks/{number}/thumbnail.png", get(thumbnails::of_task))
}
