//! The page of a run, and redirects to its submissions.

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use axum::response::{IntoResponse as _, Redirect};
use serde::Deserialize;

use super::html::{self, PageResult, Preview};
use crate::app::accounts::events::last;
use crate::app::boards::agents::{Telling, telling};
use crate::app::boards::breakdown::GroupBy;
use crate::app::boards::tasks::TaskResult;
use crate::app::cards::card::{Card, Link, Openness};
use crate::app::runs::read::answer;
use crate::app::runs::results::{TasksOfRun, results};
use crate::clock::rfc3339;
use crate::http::boards::body::BoardRow;
use crate::http::boards::comparisons::Breakdown;
use crate::http::extract::origin::Origin;
use crate::http::extract::params;
use crate::http::state::AppState;
use crate::store::run_rows::RunRow;
use crate::store::submissions::SubmissionRow;
use plumbline_engine::tasks::Task;
use plumbline_engine::tasks::catalogue::Entry;

/// Problems of one family.
struct Family {
    name: String,
    solved: usize,
    graded: usize,
    all: usize,
    squares: Vec<Square>,
}

impl Family {
    /// Returns the number of the first task that the run has a build for.
    fn built(&self) -> Option<u32> {
        self.squares.iter().find(|square| !square.class.is_empty()).map(|square| square.number)
    }
}

/// Which problems the page of a run shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Show {
    /// All problems.
    #[default]
    All,
    /// Those that are not solved.
    Failed,
}

/// Query of the page of a run.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RunQuery {
    #[serde(default)]
    show: Show,
}

/// A problem, shown as a small coloured square and as a card.
struct Square {
    number: u32,
    task: String,
    class: &'static str,
    told: &'static str,
}

#[derive(Template)]
#[template(path = "run.html")]
struct RunPage {
    run: RunRow,
    begun: String,
    anonymous_until: Option<String>,
    withdrawn: Option<(String, String)>,
    /// Who could withdraw it: its owner, or the operator if it has none.
    withdrawn_by: &'static str,
    row: Option<BoardRow>,
    is_hidden: bool,
    copied_from: usize,
    actions: Vec<(String, String, String, String)>,
    families: Vec<Family>,
    only_failed: bool,
    tables: Vec<(&'static str, Breakdown)>,
    metadata: String,
    card: Vec<(&'static str, String)>,
    links: Vec<Link>,
    preview: Preview,
    /// Another run of the track to compare it with: which it is, its identifier and its agent.
    best: Option<(&'static str, String, String)>,
    /// Number of the last event before the page was made: the page follows those after it.
    last_event: i64,
}

/// Serves the page of a run.
///
/// # Errors
/// Returns a 404 error if the run does not exist.
pub async fn run(
    State(state): State<AppState>,
    origin: Origin,
    Path(id): Path<String>,
    RawQuery(raw): RawQuery,
) -> PageResult {
    let query: RunQuery = params::read(&html::set_fields(raw.as_deref()))?;
    let last_event = last(&state).await?;
    let mut results = results(&state, &id).await?;
    let anonymous_until = results.run.embargo.as_ref().map(|embargo| rfc3339(embargo.until_ms));
    let withdrawn_by = if results.run.owner.is_some() { "its owner" } else { "the operator" };
    if anonymous_until.is_some() {
        (results.run.owner, results.run.card) = (None, None);
    }
    let squares = match &results.tasks {
        TasksOfRun::Finished(all) => {
            results.board.entry.suite.tasks.iter().zip(all).map(|(task, result)| square(task, *result)).collect()
        }
        TasksOfRun::Underway(rows) => rows.iter().map(|row| square_so_far(row, &results.board.entry)).collect(),
    };
    let tables = [
        ("By criterion", GroupBy::Criterion),
        ("By category", GroupBy::Category),
        ("By family", GroupBy::Family),
        ("By wording", GroupBy::Wording),
    ];
    let tables = tables.into_iter().filter_map(|(title, by)| Some((title, Breakdown::from(results.breakdown(by)?))));
    let is_hidden = results.is_hidden();
    let card: Option<Card> = results.run.card.clone().and_then(|card| serde_json::from_value(card).ok());
    let card = card.unwrap_or_default();
    let suite = &results.board.entry.suite;
    let shown = results.row.as_ref().and_then(|row| {
        let Telling { best, worst } = telling(&results.board, &row.standing);
        best.first().or(worst.first()).map(|place| suite.tasks[*place].number)
    });
    let best = results.row.as_ref().filter(|row| row.places.is_some()).and_then(|row| {
        let mut of_track = results.board.rows.all.iter().filter(|other| other.track == row.standing.track);
        let first = of_track.next()?;
        let (which, other) =
            if first.run == id { ("the next best run", of_track.next()?) } else { ("the best run", first) };
        Some((which, other.run.clone(), other.agent.clone()))
    });
    let preview = Preview {
        origin,
        path: format!("/runs/{id}"),
        title: match &results.row {
            Some(row) => format!("{}: {} on {}", row.standing.agent, html::percent(row.standing.rate()), suite.id()),
            None => format!("{} on {}", results.run.agent, suite.id()),
        },
        image: shown.map(|number| format!("/runs/{id}/tasks/{number}/preview.png")),
    };
    html::page(&RunPage {
        last_event,
        best,
        preview,
        begun: rfc3339(results.run.created_at_ms),
        anonymous_until,
        withdrawn_by,
        withdrawn: results.run.withdrawn.clone().map(|(at_ms, reason)| (rfc3339(at_ms), reason)),
        is_hidden,
        copied_from: results.row.as_ref().map_or(0, |row| row.copied_from),
        tables: tables.filter(|(_, rates)| !rates.groups.is_empty()).collect(),
        actions: results.actions.into_iter().map(|a| (rfc3339(a.at_ms), a.action, a.actor, a.reason)).collect(),
        row: results.row.map(BoardRow::from),
        metadata: serde_json::to_string_pretty(&results.run.metadata).unwrap_or_default(),
        families: families(squares, query.show),
        only_failed: query.show == Show::Failed,
        card: rows_of(&card),
        links: card.links,
        run: results.run,
    })
}

/// Returns what a card declares, in words; what it does not declare has no row.
fn rows_of(card: &Card) -> Vec<(&'static str, String)> {
    let joined = |parts: [Option<&str>; 2]| parts.into_iter().flatten().collect::<Vec<_>>().join(" ");
    let harness = card.harness.as_ref().map(|it| joined([it.name.as_deref(), it.version.as_deref()]));
    let model = card.model.as_ref().map(|it| joined([it.name.as_deref(), it.revision.as_deref()]));
    let openness = card.model.as_ref().and_then(|model| model.openness).map(|openness| match openness {
        Openness::OpenSource => "weights, code and data are open",
        Openness::OpenWeights => "weights are open",
        Openness::Closed => "closed",
    });
    let sampling = card.sampling.as_ref();
    let tokens = card.tokens.as_ref();
    let rows = [
        ("Agent's version", card.agent_version.clone()),
        ("Harness", harness),
        ("Model", model),
        ("Openness", openness.map(ToOwned::to_owned)),
        ("System prompt, SHA-256", card.system_prompt.as_ref().and_then(|prompt| prompt.sha256.clone())),
        ("Temperature", sampling.and_then(|it| it.temperature).map(|number| number.to_string())),
        ("Top p", sampling.and_then(|it| it.top_p).map(|number| number.to_string())),
        ("Most tokens of an answer", sampling.and_then(|it| it.max_tokens).map(|number| number.to_string())),
        ("Seed", sampling.and_then(|it| it.seed).map(|number| number.to_string())),
        ("Reasoning effort", sampling.and_then(|it| it.reasoning_effort.clone())),
        ("Input tokens", tokens.and_then(|it| it.input).map(|number| number.to_string())),
        ("of these cached", tokens.and_then(|it| it.cached_input).map(|number| number.to_string())),
        ("Output tokens", tokens.and_then(|it| it.output).map(|number| number.to_string())),
        ("of these reasoning", tokens.and_then(|it| it.reasoning).map(|number| number.to_string())),
        ("Cost", card.cost.as_ref().map(|it| format!("{} {}, prices of {}", it.amount, it.currency, it.prices_as_of))),
        ("Configuration, SHA-256", card.configuration_sha256.clone()),
    ];
    rows.into_iter().filter_map(|(label, value)| Some((label, value.filter(|text| !text.is_empty())?))).collect()
}

/// Groups problems by family, in the order of the suite.
fn families(squares: Vec<Square>, show: Show) -> Vec<Family> {
    let mut families: Vec<Family> = Vec::new();
    for square in squares {
        let name = square.task.split('/').next().unwrap_or_default();
        let at = families.iter().position(|family| family.name == name).unwrap_or_else(|| {
            families.push(Family { name: name.to_owned(), solved: 0, graded: 0, all: 0, squares: Vec::new() });
            families.len() - 1
        });
        let family = &mut families[at];
        let is_solved = square.class == "solved";
        family.all += 1;
        family.graded += usize::from(!square.class.is_empty());
        family.solved += usize::from(is_solved);
        if show == Show::All || !is_solved {
            family.squares.push(square);
        }
    }
    families.retain(|family| !family.squares.is_empty());
    families
}

fn square(task: &Task, result: TaskResult) -> Square {
    let (class, told) = match result {
        TaskResult::Skipped => ("", "skipped"),
        TaskResult::NotAnswered => ("", "not answered"),
        TaskResult::Solved => ("solved", "solved"),
        TaskResult::Accurate => ("accurate", "accurate, but not solved"),
        TaskResult::Failed => ("failed", "not solved"),
    };
    Square { number: task.number, task: task.id.clone(), class, told }
}

/// Builds the square of a submission to a run that has not finished.
fn square_so_far(row: &SubmissionRow, entry: &Entry) -> Square {
    let (class, told) = match row.overall {
        Some(true) => ("solved", "solved"),
        Some(false) => ("failed", "not solved"),
        None => ("", row.state.name()),
    };
    let task = entry.task_numbered(row.task_number).map(|(task, _)| task.id.clone()).unwrap_or_default();
    Square { number: row.task_number, task, class, told }
}

/// Redirects to a run's submission for a task.
///
/// # Errors
/// Returns a 404 error if the run has no submission for the task.
pub async fn task_of_run(State(state): State<AppState>, Path((run, number)): Path<(String, u32)>) -> PageResult {
    let row = answer(&state, &run, number).await?;
    Ok(Redirect::to(&format!("/submissions/{}", row.id)).into_response())
}
