//! Pages of tasks: the list of a suite's tasks, and the page of one task with an example build.

use std::collections::BTreeSet;
use std::sync::Arc;

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use axum::http::header;
use axum::response::IntoResponse as _;
use serde::Deserialize;
use serde_json::{Value, json};

use super::claims;
use super::html::{self, PageResult, Preview, json_in_markup};
use super::looks::looks_of;
use super::submission::{View, image, picture_on_ground};
use crate::app::boards::tasks::{ResultsOnTask, SolvedTasks, TaskResult, results_on, search};
use crate::app::catalogue::tasks::example;
use crate::app::error::AppError;
use crate::http::extract::origin::Origin;
use crate::http::extract::params;
use crate::http::state::AppState;
use plumbline_engine::builders::build;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::tasks::{Suite, Task};
use plumbline_engine::text::did_you_mean;
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

/// Query of the task list; an empty field does not filter.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TasksQuery {
    /// Text to find in ids, types and prompts.
    #[serde(default)]
    text: String,
    /// Family of the tasks.
    family: Option<String>,
    /// Criterion that applies to the tasks.
    criterion: Option<Criterion>,
    /// Difficulty of the tasks, as the runs on the board have measured it.
    difficulty: Option<Difficulty>,
}

/// Difficulty of a task, by the share of compared runs that solve it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Difficulty {
    /// At least 80 % solve it.
    Easy,
    /// Some solve it.
    Medium,
    /// At most 20 % solve it.
    Hard,
    /// No run solves it.
    Unsolved,
}

impl Difficulty {
    /// All difficulties with their names in queries and on pages.
    const ALL: [(Self, &'static str, &'static str); 4] = [
        (Self::Easy, "easy", "easy: 80 % or more of the runs"),
        (Self::Medium, "medium", "medium"),
        (Self::Hard, "hard", "hard: 20 % or less"),
        (Self::Unsolved, "unsolved", "solved by no run"),
    ];

    /// Returns whether a task that so many of the runs solve is of this difficulty.
    fn holds(self, solved: usize, runs: usize) -> bool {
        let share = solved as f64 / runs.max(1) as f64;
        match self {
            Self::Easy => runs > 0 && share >= 0.8,
            Self::Medium => share > 0.2 && share < 0.8,
            Self::Hard => runs > 0 && share <= 0.2,
            Self::Unsolved => solved == 0,
        }
    }
}

#[derive(Template)]
#[template(path = "tasks.html")]
struct TasksPage {
    suite: String,
    query: TasksQuery,
    runs: usize,
    count: usize,
    names: Vec<String>,
    families: Vec<Family>,
}

impl TasksPage {
    fn is_filtered(&self) -> bool {
        let TasksQuery { text, family, criterion, difficulty } = &self.query;
        !text.is_empty() || family.is_some() || criterion.is_some() || difficulty.is_some()
    }
}

/// Serves the list of a suite's tasks, each with the number of runs that solved it.
///
/// # Errors
/// Returns a 404 error if the suite does not exist and a 400 error if a parameter is invalid.
pub async fn tasks(State(state): State<AppState>, Path(suite): Path<String>, RawQuery(raw): RawQuery) -> PageResult {
    let query: TasksQuery = params::read(&html::set_fields(raw.as_deref()))?;
    let SolvedTasks { board, tasks } = search(&state, &suite, &query.text).await?;
    let (suite, runs) = (&board.entry.suite, board.rows.all.len());
    let names: BTreeSet<&str> = suite.tasks.iter().map(Task::family).collect();
    if let Some(family) = query.family.as_deref().filter(|family| !names.contains(family)) {
        let near = did_you_mean(family, names);
        return Err(
            AppError::wrong_parameter("family", format!("{} has no family {family:?}{near}", suite.id())).into()
        );
    }
    let mut families: Vec<Family> = Vec::new();
    let mut count = 0;
    for (place, solved) in tasks {
        let task = &suite.tasks[place];
        let is_wanted = query.family.as_ref().is_none_or(|family| family == task.family())
            && query.criterion.is_none_or(|criterion| task.criteria().contains(&criterion))
            && query.difficulty.is_none_or(|difficulty| difficulty.holds(solved, runs));
        if !is_wanted {
            continue;
        }
        count += 1;
        let at = families.iter().position(|family| family.name == task.family()).unwrap_or_else(|| {
            families.push(Family { name: task.family().to_owned(), tasks: Vec::new() });
            families.len() - 1
        });
        let card = TaskCard { number: task.number, id: task.id.clone(), turns: task.turns.len(), solved };
        families[at].tasks.push(card);
    }
    let names = names.into_iter().map(ToOwned::to_owned).collect();
    html::page(&TasksPage { suite: suite.id(), runs, count, names, families, query })
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
    preview: Preview,
}

fn view(suite: &Suite, task: &Task, log: &BlockLog) -> Result<View, AppError> {
    let json: Value = serde_json::from_slice(&log.canonical_json()).map_err(|error| AppError::internal(&error))?;
    let names = json["palette"].as_array().map(Vec::as_slice).unwrap_or_default();
    let looks = looks_of(names.iter().filter_map(Value::as_str));
    Ok(View {
        scene: json_in_markup(&json!({ "log": json, "looks": looks })),
        picture: format!("/suites/{}/tasks/{}/view.svg", suite.id(), task.number),
        name: format!("Reference build for {}", task.id),
        camera: "",
        has_stress: false,
        has_witnesses: false,
        has_reference: false,
    })
}

/// Serves the page of a task: its prompts, its checks, an example build and the results of runs.
///
/// # Errors
/// Returns a 404 error if the suite or the task does not exist.
pub async fn task(
    State(state): State<AppState>,
    origin: Origin,
    Path((suite, number)): Path<(String, u32)>,
) -> PageResult {
    let ResultsOnTask { found, runs, solved, results } = results_on(&state, &suite, number).await?;
    let told = |(row, result): (Arc<Standing>, TaskResult)| match result {
        TaskResult::Solved => (row, "good", "solved"),
        TaskResult::Accurate => (row, "bad", "accurate, but not solved"),
        TaskResult::Failed | TaskResult::Skipped | TaskResult::NotAnswered => (row, "bad", "not solved"),
    };
    let (suite, task) = (&found.entry.suite, found.task());
    // Tasks imported from other sources may have no builder.
    let view = build(task).ok().map(|log| view(suite, task, &log)).transpose()?;
    let path = format!("/suites/{}/tasks/{number}", suite.id());
    html::page(&TaskPage {
        suite: suite.id(),
        runs,
        solved,
        rows: results.into_iter().map(told).collect(),
        preview: Preview {
            origin,
            title: format!("{}: solved by {solved} of {}", task.id, html::counted(runs, "run")),
            image: view.is_some().then(|| format!("{path}/preview.png")),
            path,
        },
        view,
        task: task.clone(),
    })
}

/// Serves a picture of the example build of a task.
///
/// # Errors
/// Returns a 404 error if the suite or the task does not exist, or no builder can build it.
pub async fn picture(State(state): State<AppState>, Path((suite, number)): Path<(String, u32)>) -> PageResult {
    let log = example(&state, &suite, number).await?;
    Ok(image(Replay::new(&log).last().map(|end| picture_on_ground(&end)).unwrap_or_default()))
}

/// Serves the log of the reference build of a task.
///
/// # Errors
/// Returns a 404 error if the suite or the task does not exist, or no builder can build it.
pub async fn reference(State(state): State<AppState>, Path((suite, number)): Path<(String, u32)>) -> PageResult {
    let log = example(&state, &suite, number).await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], log.canonical_json()).into_response())
}
