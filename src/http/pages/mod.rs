//! Web pages, rendered on the server. They load nothing from other hosts. Scripts add the 3D view,
//! running countdowns, buttons that copy, and updates of what is under way.

mod about;
mod agent;
mod arguments;
pub mod assets;
mod board;
mod board_links;
mod charts;
mod claims;
mod compare;
mod epochs;
mod findings;
mod home;
mod html;
mod lines;
mod log;
mod looks;
mod moderation;
mod reference;
mod run;
mod search;
mod submission;
mod task;
pub mod thumbnails;

use axum::Router;
use axum::response::Redirect;
use axum::routing::get;

use self::thumbnails::{PREVIEW, THUMBNAIL};
use super::state::AppState;

/// Returns the routes of the pages.
pub fn routes() -> Router<AppState> {
    Router::new()
        .merge(moderation::routes())
        .merge(reference::routes())
        .route("/", get(home::home))
        .route("/about", get(about::page))
        .route("/assets/{name}", get(assets::get))
        .route("/boards/{suite}", get(board::board))
        .route("/boards/{suite}/charts", get(charts::charts))
        .route("/boards/{suite}/charts/{file}", get(charts::file))
        .route("/boards/{suite}/log", get(log::page))
        .route("/boards/{suite}/compare", get(compare::compare_runs))
        .route("/boards/{suite}/compare.svg", get(compare::picture))
        .route("/boards/{suite}/compare.csv", get(compare::table))
        .route("/runs/{id}", get(run::run))
        .route("/runs/{id}/tasks/{number}", get(run::task_of_run))
        .route("/runs/{id}/tasks/{number}/thumbnail.png", get(thumbnails::of_run::<THUMBNAIL>))
        .route("/runs/{id}/tasks/{number}/preview.png", get(thumbnails::of_run::<PREVIEW>))
        .route("/submissions/{id}", get(submission::submission))
        .route("/submissions/{id}/view.svg", get(submission::picture))
        .route("/submissions/{id}/thumbnail.png", get(thumbnails::of_submission::<THUMBNAIL>))
        .route("/submissions/{id}/preview.png", get(thumbnails::of_submission::<PREVIEW>))
        .route("/submissions/{id}/evidence.html", get(submission::evidence))
        .route("/agents/{*name}", get(agent::page))
        .route("/search", get(search::page))
        .route("/boards", get(async || Redirect::permanent("/boards/mineceraft")))
        .route("/agents", get(async || Redirect::permanent("/search")))
        .route("/epochs", get(epochs::epochs))
        .route("/epochs/{id}", get(epochs::epoch))
        .route("/compare", get(submission::beside))
        .route("/suites/{suite}/tasks", get(task::tasks))
        .route("/suites/{suite}/tasks/{number}", get(task::task))
        .route("/suites/{suite}/tasks/{number}/view.svg", get(task::picture))
        .route("/suites/{suite}/tasks/{number}/reference.json", get(task::reference))
        .route("/suites/{suite}/tasks/{number}/thumbnail.png", get(thumbnails::of_task::<THUMBNAIL>))
        .route("/suites/{suite}/tasks/{number}/preview.png", get(thumbnails::of_task::<PREVIEW>))
}
