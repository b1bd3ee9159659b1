//! Rates of runs by group of tasks.

use std::collections::HashMap;
use std::sync::Arc;

use serde::Deserialize;

use super::cache::Board;
use super::read;
use crate::app::App;
use crate::app::error::AppResult;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::summary::ProblemRate;
use plumbline_engine::tasks::Task;

/// Maximum number of rows in a breakdown.
const MAX_ROWS: usize = 50;

/// Grouping of tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroupBy {
    /// By family: the part of a task's identifier before the slash.
    #[default]
    Family,
    /// By category, of which there are five.
    Category,
    /// By the task types of the paper.
    Type,
    /// By the wording of problems that come in several wordings.
    Wording,
    /// By criterion; a task belongs to the group of each criterion that applies to it.
    Criterion,
}

/// Rates of runs by group of tasks.
#[derive(Debug)]
pub struct Breakdown {
    /// `name@version` of the suite.
    pub suite: String,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// Runs, each with its rate in each group, in the order of `groups`.
    pub rows: Vec<(Arc<Standing>, Vec<ProblemRate>)>,
}

/// Computes the rates of the best runs of a board, or of one run, in each group of tasks.
///
/// # Errors
/// Returns an error if there is no such suite, if its board has no such run, or if the database fails.
pub async fn breakdown(app: &App, suite: &str, by: GroupBy, run: Option<&str>) -> AppResult<Breakdown> {
    let board = read::board(app, suite).await?;
    let rows = match run {
        Some(run) => vec![Arc::clone(read::standing(&board, run)?)],
        None => board.rows.all.iter().take(MAX_ROWS).cloned().collect(),
    };
    Ok(of_rows(&board, by, &rows))
}

/// Computes the rates of the given runs in each group of tasks.
#[must_use]
pub fn of_rows(board: &Board, by: GroupBy, rows: &[Arc<Standing>]) -> Breakdown {
    let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
    let mut number: HashMap<String, usize> = HashMap::new();
    for (place, task) in board.entry.suite.tasks.iter().enumerate() {
        for name in groups_of(board, by, place, task) {
            let next = groups.len();
            let group = *number.entry(name.clone()).or_insert(next);
            if group == next {
                groups.push((name, Vec::new()));
            }
            groups[group].1.push(place);
        }
    }
    if by == GroupBy::Criterion {
        groups.sort_by_key(|(name, _)| Criterion::ALL.iter().position(|criterion| criterion.name() == name));
    }
    let passes = |row: &Standing, name: &str, place: usize| match Criterion::ALL.iter().find(|c| c.name() == name) {
        Some(criterion) if by == GroupBy::Criterion => row.outcomes.holds(place, *criterion),
        _ => row.outcomes.is_solved(place),
    };
    let cells = |row: &Standing| {
        let cell = |(name, places): &(String, Vec<usize>)| {
            let pass = places.iter().filter(|place| passes(row, name, **place)).count() as u64;
            let of = places.len() as u64;
            ProblemRate { pass, of, rate: (of > 0).then(|| pass as f64 / of as f64) }
        };
        groups.iter().map(cell).collect()
    };
    Breakdown {
        suite: board.entry.id.clone(),
        rows: rows.iter().map(|row| (Arc::clone(row), cells(row))).collect(),
        groups: groups.into_iter().map(|(name, _)| name).collect(),
    }
}

fn groups_of(board: &Board, by: GroupBy, place: usize, task: &Task) -> Vec<String> {
    match by {
        GroupBy::Family => vec![task.family().to_owned()],
        GroupBy::Category => task.category.iter().map(|category| category.name().to_owned()).collect(),
        GroupBy::Type => task.kind.iter().cloned().collect(),
        GroupBy::Wording => board.field.wording(place).map(|w| format!("{}: {w}", task.family())).into_iter().collect(),
        GroupBy::Criterion => task.criteria().iter().map(|criterion| criterion.name().to_owned()).collect(),
    }
}
