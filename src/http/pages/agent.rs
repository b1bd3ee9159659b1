//! The page of an agent: all its runs, its scores over time, and the builds that tell most about it.

use askama::Template;
use axum::extract::{Path, State};

use super::html::{self, PageResult};
use super::lines::{Line, lines};
use crate::app::boards::agents::{OnBoard, Telling, agent, telling};
use crate::clock::rfc3339;
use crate::http::boards::body::WithdrawnRow;
use crate::http::state::AppState;
use crate::store::run_rows::RunRow;
use plumbline_engine::tasks::Track;

/// Runs on one board.
struct Section {
    suite: String,
    /// Number of rows beyond those shown.
    not_shown: usize,
    lines: Vec<Line>,
    withdrawn: Vec<WithdrawnRow>,
    /// Track of the best run, whose progress a chart shows if there are several.
    track: Option<Track>,
    best: Option<BestRun>,
}

/// The best run on a board, with the builds that tell most about it.
struct BestRun {
    run: String,
    best: Vec<Build>,
    worst: Vec<Build>,
}

/// A build for a task.
struct Build {
    number: u32,
    task: String,
}

#[derive(Template)]
#[template(path = "agent.html")]
struct AgentPage {
    name: String,
    sections: Vec<Section>,
    open: Vec<(RunRow, String)>,
}

/// Serves the page of an agent.
///
/// # Errors
/// Returns a 404 error, which names similar agents, if no public run has this agent.
pub async fn page(State(state): State<AppState>, Path(name): Path<String>) -> PageResult {
    let known = agent(&state, &name).await?;
    let mut sections = Vec::new();
    for OnBoard { board, rows, count, withdrawn } in known.boards {
        let tasks = &board.entry.suite.tasks;
        let first = rows.first().map(|row| std::sync::Arc::clone(&row.standing));
        let of_track = |track| rows.iter().filter(|row| row.standing.track == track && row.places.is_some()).count();
        let build = |place: usize| Build { number: tasks[place].number, task: tasks[place].id.clone() };
        let told = |run: &plumbline_engine::grading::standings::Standing| {
            let Telling { best, worst } = telling(&board, run);
            let builds = |places: Vec<usize>| places.into_iter().map(build).collect();
            BestRun { run: run.run.clone(), best: builds(best), worst: builds(worst) }
        };
        sections.push(Section {
            suite: board.entry.id.clone(),
            not_shown: count - rows.len(),
            track: first.as_ref().map(|run| run.track).filter(|track| of_track(*track) > 1),
            best: first.as_deref().map(told).filter(|it| !(it.best.is_empty() && it.worst.is_empty())),
            lines: lines(&state, rows).await?,
            withdrawn: withdrawn.into_iter().map(WithdrawnRow::from).collect(),
        });
    }
    let open = known.open.into_iter().map(|run| {
        let begun = rfc3339(run.created_at_ms);
        (run, begun)
    });
    html::page(&AgentPage { open: open.collect(), name, sections })
}
