//! Pages of tasks: the list of a suite's tasks, and the page of one task with an example build.

use std::sync::Arc;

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use serde::Deserialize;
use serde_json::{Value, json};

use super::html::{self, PageResult, json_in_markup};
use super::isometric;
use super::submission::{View, colours_of, image};
use crate::app::error::AppError;
use crate::http::extract::params;
use crate::http::state::AppState;
use plumbline_engine::builders::build;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::tasks::Task;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::voxel::BlockLog;
use plumbline_engine::voxel::replay::Replay;

/// Greatest number of runs shown on the page of a task.
const RUNS: usize = 50;

struct TaskRow {
    number: u32,
    id: String,
    kind: String,
    turns: usize,
    criteria: String,
    solved: usize,
}

/// Query of the task list: text to find in ids, types and prompts; empty for all tasks.
#[derive(Debug, Deserialize)]
pub struct TasksQuery {
    #[serde(default)]
    text: String,
}

#[derive(Template)]
#[template(path = "tasks.html")]
struct TasksPage {
    suite: String,
    text: String,
    runs: usize,
    tasks: Vec<TaskRow>,
}

/// Serves the list of a suite's tasks, each with the number of runs that solved it.
///
/// # Errors
/// Returns a 404 error if the suite does not exist.
pub async fn tasks(State(state): State<AppState>, Path(suite): Path<String>, RawQuery(raw): RawQuery) -> PageResult {
    let query: TasksQuery = params::read(raw.as_deref().unwrap_or_default())?;
    let entry = state.suite(&suite).await?;
    let board = state.boards.of(&state.store, state.least_coverage, &entry).await?;
    let text = query.text.trim().to_lowercase();
    let fits = |task: &Task| {
        text.is_empty()
            || task.id.contains(&text)
            || task.kind.as_ref().is_some_and(|kind| kind.contains(&text))
            || task.turns.iter().any(|turn| turn.prompt.to_lowercase().contains(&text))
    };
    let row = |(place, task): (usize, &Task)| TaskRow {
        number: task.number,
        id: task.id.clone(),
        kind: task.kind.clone().unwrap_or_default(),
        turns: task.turns.len(),
        criteria: task.criteria().iter().map(|criterion| criterion.name()).collect::<Vec<_>>().join(", "),
        solved: board.rows.all.iter().filter(|row| row.outcomes.is_solved(place)).count(),
    };
    let all = entry.suite.tasks.iter().enumerate().filter(|(_, task)| fits(task)).map(row);
    html::page(&TasksPage {
        suite: entry.suite.id(),
        runs: board.rows.all.len(),
        tasks: all.collect(),
        text: query.text,
    })
}

#[derive(Template)]
#[template(path = "task.html")]
struct TaskPage {
    suite: String,
    task: Task,
    view: Option<View>,
    runs: usize,
    solved: usize,
    rows: Vec<(Arc<Standing>, &'static str, &'static str)>,
}

fn found(entry: &Entry, number: u32) -> Result<&Task, AppError> {
    let found = entry.task_numbered(number).map(|(task, _)| task);
    found.ok_or_else(|| AppError::not_found(format!("{} has no task {number}", entry.suite.id())))
}

fn view(entry: &Entry, task: &Task, log: &BlockLog) -> Result<View, AppError> {
    let json: Value = serde_json::from_slice(&log.canonical_json()).map_err(|error| AppError::internal(&error))?;
    let names = json["palette"].as_array().map(Vec::as_slice).unwrap_or_default();
    let colours = colours_of(names.iter().filter_map(Value::as_str));
    Ok(View {
        scene: json_in_markup(&json!({ "log": json, "colours": colours })),
        picture: format!("/suites/{}/tasks/{}/view.svg", entry.suite.id(), task.number),
        name: format!("Example build for {}", task.id),
        camera: "",
        has_stress: false,
        has_witnesses: false,
    })
}

/// Serves the page of a task: its prompts, its checks, an example build and the results of runs.
///
/// # Errors
/// Returns a 404 error if the suite or the task does not exist.
pub async fn task(State(state): State<AppState>, Path((suite, number)): Path<(String, u32)>) -> PageResult {
    let entry = state.suite(&suite).await?;
    let task = found(&entry, number)?;
    let place = entry.suite.tasks.iter().position(|other| other.number == number).unwrap_or_default();
    let board = state.boards.of(&state.store, state.least_coverage, &entry).await?;
    let rows = board.rows.all.iter().filter(|row| row.outcomes.is_answered(place)).take(RUNS).map(|row| {
        let (class, told) = match &row.outcomes {
            o if o.is_solved(place) => ("good", "solved"),
            o if o.is_accurate(place) => ("bad", "accurate, but not solved"),
            _ => ("bad", "not solved"),
        };
        (Arc::clone(row), class, told)
    });
    html::page(&TaskPage {
        suite: entry.suite.id(),
        runs: board.rows.all.len(),
        solved: board.rows.all.iter().filter(|row| row.outcomes.is_solved(place)).count(),
        rows: rows.collect(),
        // Tasks imported from other sources may have no builder.
        view: build(task).ok().map(|log| view(&entry, task, &log)).transpose()?,
        task: task.clone(),
    })
}

/// Serves a picture of the example build of a task.
///
/// # Errors
/// Returns a 404 error if the suite or the task does not exist, or no builder can build it.
pub async fn picture(State(state): State<AppState>, Path((suite, number)): Path<(String, u32)>) -> PageResult {
    let entry = state.suite(&suite).await?;
    let log = build(found(&entry, number)?)
        .map_err(|error| AppError::not_found(format!("this task has no example build: {error}")))?;
    Ok(image(Replay::new(&log).last().map(|end| isometric::svg(&end)).unwrap_or_default()))
}
