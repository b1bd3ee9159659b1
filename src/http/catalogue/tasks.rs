//! `/v1/tasks`: tasks with their instructions and checks.

use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::app::catalogue::tasks::{self, FoundTask, TaskFilter};
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::http::catalogue::datasets::{DataSet, RowScheme, TaskFormat};
use crate::http::extract::caller::Reader;
use crate::http::extract::conditional::tagged_json;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::checks::{Check, Criterion};
use plumbline_engine::tasks::family::Category;
use plumbline_engine::tasks::{Suite, Task, Track};
use plumbline_engine::voxel::{Profile, Reading};

/// Summary of a task in a list.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct TaskSummary {
    /// Identifier of the task: `family/instance`.
    #[schema(example = "walls/5x1x5-raise")]
    pub id: String,
    /// Number of the task in the suite: the `run_idx` of published records.
    #[schema(example = 113)]
    pub number: u32,
    /// Family of the task.
    #[schema(example = "walls")]
    pub family: String,
    /// Category; absent if the task does not come from a family file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub category: Option<Category>,
    /// Task type of the paper; absent if the task does not come from a family file.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    #[schema(example = "walls")]
    pub kind: Option<String>,
    /// Number of turns.
    #[schema(example = 1)]
    pub turns: usize,
    /// Criteria that apply to the task.
    pub criteria: Vec<Criterion>,
    /// Instruction of the first turn.
    pub prompt: String,
    /// Instructions of all turns.
    pub prompts: Vec<String>,
}

/// A page of tasks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct TaskPage {
    /// `name@version` of the suite.
    #[schema(example = "mineceraft@4")]
    pub suite: String,
    /// Number of tasks that match the filters, on all pages.
    pub total: usize,
    /// Tasks of this page, sorted by number.
    pub tasks: Vec<TaskSummary>,
    /// Value of `after` for the next page; null on the last page.
    pub next_after: Option<u32>,
}

/// A check of a task.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct CheckBody {
    /// Name of the check.
    #[serde(rename = "fn")]
    #[schema(example = "shape.has_rooms")]
    pub name: &'static str,
    /// Arguments of the check.
    #[schema(value_type = Object, example = json!({ "room_cnt": 2 }))]
    pub args: Value,
    /// Criterion that the check counts towards.
    pub criterion: Criterion,
    /// What is measured, in words.
    #[schema(example = "Walls enclose at least the given number of rooms on one level")]
    pub asks: &'static str,
}

impl CheckBody {
    fn of(check: &Check) -> Self {
        let mut data = serde_json::to_value(check).expect("a check is JSON");
        let args = data.get_mut("args").map(Value::take).unwrap_or_default();
        Self { name: check.name(), args, criterion: check.criterion(), asks: check.asks() }
    }
}

/// One turn of a task.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct TurnBody {
    /// Instruction of the turn, on the requested track.
    pub prompt: String,
    /// Instruction of the turn on the track `brief`; absent if the suite has no such track, and for an agent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brief: Option<String>,
    /// Checks that count towards the verdict; absent for an agent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub checks: Option<Vec<CheckBody>>,
    /// Checks whose results are shown but do not count.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub informational: Vec<CheckBody>,
}

/// A task with its instructions and checks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct TaskBody {
    /// Identifier of the task: `family/instance`.
    #[schema(example = "walls/5x1x5-raise")]
    pub id: String,
    /// Number of the task in the suite: the `run_idx` of published records.
    #[schema(example = 113)]
    pub number: u32,
    /// Family of the task.
    #[schema(example = "walls")]
    pub family: String,
    /// Category; absent if the task does not come from a family file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub category: Option<Category>,
    /// Task type of the paper; absent if the task does not come from a family file.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    #[schema(example = "walls")]
    pub kind: Option<String>,
    /// Parameters from which the family generates this task; absent for an agent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>, example = json!({ "w": 5, "t": 1, "h": 5 }))]
    pub parameters: Option<Value>,
    /// `name@version` of the suite.
    #[schema(example = "mineceraft@4")]
    pub suite: String,
    /// SHA-256 of the task's content, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub hash: String,
    /// How the blocks of a log are read before they are checked, unless each entry counts as it is listed; absent for an
    /// agent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reading: Option<Reading>,
    /// Criteria that apply to the task; absent for an agent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub criteria: Option<Vec<Criterion>>,
    /// What the prompts mention and no check measures.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unmeasured: Vec<String>,
    /// Turns, in order.
    pub turns: Vec<TurnBody>,
}

/// Query of a list of tasks.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TaskListQuery {
    /// Suite, as `name` or `name@version`.
    #[param(example = "mineceraft")]
    suite: Option<String>,
    /// Only tasks of this family.
    family: Option<String>,
    /// Only tasks of this category.
    category: Option<Category>,
    /// Only tasks of this type.
    #[serde(rename = "type")]
    #[param(example = "walls")]
    kind: Option<String>,
    /// Only tasks to which this criterion applies.
    criterion: Option<Criterion>,
    /// Track of the instructions in the answer; `specified` by default.
    #[param(inline)]
    track: Option<Track>,
    /// Only tasks whose identifier or instructions contain this text; case is ignored.
    text: Option<String>,
    /// Only tasks with a greater number, for paging.
    after: Option<u32>,
    /// Maximum number of tasks on the page; 100 by default, and for a data set as many as a page may have.
    #[param(minimum = 1)]
    limit: Option<u32>,
    /// Format of the answer: a page of tasks, or the data set of a trainer, whose rows are the tasks of one turn.
    #[param(inline)]
    format: Option<TaskFormat>,
    /// Scheme of the rewards that a data set asks for; `shaped` by default.
    #[param(inline)]
    scheme: Option<RowScheme>,
    /// Rules under which answers to a data set's prompts become builds; `mindcraft` by default.
    #[param(inline)]
    profile: Option<Profile>,
}

/// Who a task is shown to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Audience {
    /// An agent that is to solve it: instructions, and nothing that tells the checks.
    Agent,
}

/// Query of a task.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TaskQuery {
    /// `agent` leaves out what tells the checks: the checks, the criteria and the parameters.
    #[serde(rename = "for")]
    #[param(inline)]
    audience: Option<Audience>,
    /// Track of the instructions in the answer; `specified` by default.
    #[param(inline)]
    track: Option<Track>,
    /// Suite, as `name` or `name@version`.
    #[param(example = "mineceraft")]
    suite: Option<String>,
}

impl From<TaskListQuery> for TaskFilter {
    fn from(query: TaskListQuery) -> Self {
        let TaskListQuery { suite, family, category, kind, criterion, text, after, limit, .. } = query;
        Self { suite, family, category, kind, criterion, text, after, limit }
    }
}

/// Lists the tasks of a suite.
///
/// Tasks come by number, with filters and paging, or as the data set of a trainer.
#[utoipa::path(
    get, path = "/v1/tasks", operation_id = "list_tasks", tag = "tasks", summary = "List tasks",
    params(TaskListQuery),
    responses(
        (status = 200, description = "A page of tasks, or a row for each task of one turn",
         headers(("ETag" = String, description = "Strong entity tag")), content(
            (TaskPage = "application/json", example = json!({ "suite": "mineceraft@4", "total": 723, "tasks": [], "next_after": 100 })),
            (String = "application/x-ndjson", example = "{\"prompt\":[],\"task\":\"walls/5x1x5-raise\"}\n"),
         )),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
        (status = 404, description = "There is no such suite"),
        (status = 504, description = "What the tasks of a data set can earn was not known in time"),
    )
)]
pub async fn list_tasks(
    State(state): State<AppState>,
    Reader(who): Reader,
    headers: HeaderMap,
    Params(query): Params<TaskListQuery>,
) -> AppResult<Response> {
    let (track, format) = (query.track.unwrap_or_default(), query.format.unwrap_or_default());
    let (profile, scheme) = (query.profile.unwrap_or(Profile::Mindcraft), query.scheme.unwrap_or_default());
    let mut filter = TaskFilter::from(query);
    if format != TaskFormat::Json {
        filter.limit = filter.limit.or(Some(LIMITS.page_items));
    }
    let page = tasks::list(&state, &filter).await?;
    must_have(&page.entry.suite, track)?;
    if format != TaskFormat::Json {
        let set = DataSet { format, track, profile, scheme };
        let mut tasks: Vec<&Task> = page.tasks().filter(|task| task.turns.len() == 1).collect();
        if set.is_shaped() {
            // A trainer that asks for the reward of the others would be refused.
            let beatable = state.grader.beatable(&page.entry, tasks.iter().map(|task| task.number), &who).await?;
            tasks.retain(|task| beatable.contains(&task.number));
        }
        return Ok(set.rows(&page.entry.suite, tasks.into_iter()));
    }
    let (suite, total, next_after) = (page.entry.id.clone(), page.total, page.next_after);
    tagged_json(
        &headers,
        &TaskPage { suite, total, tasks: page.tasks().map(|task| summary(task, track)).collect(), next_after },
    )
}

/// Refuses a track that the suite does not have.
fn must_have(suite: &Suite, track: Track) -> AppResult<()> {
    suite.lacks(track).map_or(Ok(()), |detail| Err(AppError::wrong_parameter("track", detail)))
}

fn summary(task: &Task, track: Track) -> TaskSummary {
    let prompts: Vec<String> =
        task.turns.iter().filter_map(|turn| turn.prompt_on(track)).map(ToOwned::to_owned).collect();
    TaskSummary {
        id: task.id.clone(),
        number: task.number,
        family: task.family().to_owned(),
        category: task.category,
        kind: task.kind.clone(),
        turns: task.turns.len(),
        criteria: task.criteria(),
        prompt: prompts.first().cloned().unwrap_or_default(),
        prompts,
    }
}

/// Returns a task.
///
/// A task comes with its instructions and its checks.
#[utoipa::path(
    get, path = "/v1/tasks/{family}/{instance}", operation_id = "get_task", tag = "tasks", summary = "Get a task",
    params(
        ("family" = String, Path, description = "The part of the task's id before the slash", example = "walls"),
        ("instance" = String, Path, description = "The part of the task's id after the slash", example = "5x1x5-raise"),
        TaskQuery,
    ),
    responses(
        (status = 200, description = "The task", headers(("ETag" = String, description = "Strong entity tag")), body = TaskBody,
         example = json!({ "id": "walls/5x1x5-raise", "number": 113, "suite": "mineceraft@4", "turns": [] })),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
    )
)]
pub async fn get_task(
    State(state): State<AppState>,
    Path((family, instance)): Path<(String, String)>,
    headers: HeaderMap,
    Params(query): Params<TaskQuery>,
) -> AppResult<Response> {
    let found = tasks::with_id(&state, query.suite.as_deref(), &format!("{family}/{instance}")).await?;
    let track = query.track.unwrap_or_default();
    must_have(&found.entry.suite, track)?;
    let mut task = body(&found, track);
    if query.audience == Some(Audience::Agent) {
        task.hide_checks();
    }
    tagged_json(&headers, &task)
}

impl TaskBody {
    /// Leaves out what tells the checks.
    fn hide_checks(&mut self) {
        (self.parameters, self.reading, self.criteria) = (None, None, None);
        for turn in &mut self.turns {
            turn.checks = None;
            turn.brief = None;
            turn.informational.clear();
        }
    }
}

fn body(found: &FoundTask, track: Track) -> TaskBody {
    let task = found.task();
    TaskBody {
        id: task.id.clone(),
        number: task.number,
        family: task.family().to_owned(),
        category: task.category,
        kind: task.kind.clone(),
        parameters: Some(Value::Object(task.parameters.clone())),
        suite: found.entry.id.clone(),
        hash: found.hash().to_owned(),
        reading: Some(task.reading).filter(|reading| !reading.is_as_listed()),
        criteria: Some(task.criteria()),
        unmeasured: task.unmeasured.clone(),
        turns: task
            .turns
            .iter()
            .map(|turn| TurnBody {
                prompt: turn.prompt_on(track).unwrap_or_default().to_owned(),
                brief: turn.brief.clone(),
                checks: Some(turn.checks.iter().map(CheckBody::of).collect()),
                informational: turn.informational.iter().map(CheckBody::of).collect(),
            })
            .collect(),
    }
}
