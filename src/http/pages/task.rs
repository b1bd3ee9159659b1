//! Pages of tasks: the list of a suite's tasks, and the page of one task with an example build.

use std::sync::Arc;

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use serde::Deserialize;
use serde_json::{Value, json};

use super::claims;
use super::html::{self, PageResult, json_in_markup};
use super::submission::{View, image, looks_of, picture_of};
use crate::app::boards::tasks::{ResultsOnTask, SolvedTasks, TaskResult, results_on, search};
use crate::app::catalogue::tasks::example;
use crate::app::error::AppError;
use crate::http::extract::params;
use crate::http::state::AppState;
use plumbline_engine::builders::build;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::tasks::{Suite, Task};
use plumbline_engine::voxel::BlockLog;
use plumbline_engine::voxel::replay::Replay;

struct TaskCard {
    number: u32,
    id: String,
    turns: usize,
    solved: usize,
}

/// Tasks of one family.
struct Family {
    name: String,
    tasks: Vec<TaskCard>,
}

impl Family {
    /// Returns the share of answers that solve their tasks, over so many runs.
    fn rate(&self, runs: usize) -> f64 {
        let solved: usize = self.tasks.iter().map(|task| task.solved).sum();
        solved as f64 / (self.tasks.len() * runs) as f64
    }
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
    count: usize,
    families: Vec<Family>,
}

/// Serves the list of a suite's tasks, each with the number of runs that solved it.
///
/// # Errors
/// Returns a 404 error if the suite does not exist.
pub async fn tasks(State(state): State<AppState>, Path(suite): Path<String>, RawQuery(raw): RawQuery) -> PageResult {
    let query: TasksQuery = params::read(raw.as_deref().unwrap_or_default())?;
    let SolvedTasks { board, tasks } = search(&state, &suite, &query.text).await?;
    let suite = &board.entry.suite;
    let count = tasks.len();
    let mut families: Vec<Family> = Vec::new();
    for (place, solved) in tasks {
        let task = &suite.tasks[place];
        let at = families.iter().position(|family| family.name == task.family()).unwrap_or_else(|| {
            families.push(Family { name: task.family().to_owned(), tasks: Vec::new() });
            families.len() - 1
        });
        let card = TaskCard { number: task.number, id: task.id.clone(), turns: task.turns.len(), solved };
        families[at].tasks.push(card);
    }
    html::page(&TasksPage { suite: suite.id(), runs: board.rows.all.len(), count, families, text: query.text })
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

fn view(suite: &Suite, task: &Task, log: &BlockLog) -> Result<View, AppError> {
    let json: Value = serde_json::from_slice(&log.canonical_json()).map_err(|error| AppError::internal(&error))?;
    let names = json["palette"].as_array().map(Vec::as_slice).unwrap_or_default();
    let looks = looks_of(names.iter().filter_map(Value::as_str));
    Ok(View {
        scene: json_in_markup(&json!({ "log": json, "looks": looks })),
        picture: format!("/suites/{}/tasks/{}/view.svg", suite.id(), task.number),
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
    let ResultsOnTask { found, runs, solved, results } = results_on(&state, &suite, number).await?;
    let told = |(row, result): (Arc<Standing>, TaskResult)| match result {
        TaskResult::Solved => (row, "good", "solved"),
        TaskResult::Accurate => (row, "bad", "accurate, but not solved"),
        TaskResult::Failed | TaskResult::Skipped | TaskResult::NotAnswered => (row, "bad", "not solved"),
    };
    let (suite, task) = (&found.entry.suite, found.task());
    html::page(&TaskPage {
        suite: suite.id(),
        runs,
        solved,
        rows: results.into_iter().map(told).collect(),
        // Tasks imported from other sources may have no builder.
        view: build(task).ok().map(|log| view(suite, task, &log)).transpose()?,
        task: task.clone(),
    })
}

/// Serves a picture of the example build of a task.
///
/// # Errors
/// Returns a 404 error if the suite or the task does not exist, or no builder can build it.
pub async fn picture(State(state): State<AppState>, Path((suite, number)): Path<(String, u32)>) -> PageResult {
    let log = example(&state, &suite, number).await?;
    Ok(image(Replay::new(&log).last().map(|end| picture_of(&end)).unwrap_or_default()))
}
