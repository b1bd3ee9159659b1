//! The page that compares two runs of a board.

use std::collections::BTreeSet;

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use serde::Deserialize;

use super::charts::figure::Figure;
use super::charts::{csv, dumbbells, svg};
use super::html::{self, PageResult};
use crate::app::boards::comparison::compare;
use crate::http::boards::comparisons::{ComparedTask, Comparison};
use crate::http::extract::params;
use crate::http::state::AppState;
use plumbline_engine::grading::statistics::ALPHA;

/// Number of tasks shown with both builds; the others are links.
const WITH_BUILDS: usize = 12;

/// The two runs to compare.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Two {
    a: String,
    b: String,
}

#[derive(Template)]
#[template(path = "compare.html")]
struct ComparePage {
    suite: String,
    told: Comparison,
    figure: Figure,
    /// Numbers of the tasks that each of the two runs left without an answer.
    unanswered: [BTreeSet<u32>; 2],
}

impl ComparePage {
    /// Says in one sentence what the test tells.
    fn verdict(&self) -> String {
        let Comparison { a, b, only_a, only_b, p_value, .. } = &self.told;
        let p = html::probability(*p_value);
        let p = if p.starts_with('<') { format!("p {p}") } else { format!("p = {p}") };
        let better = if only_a.len() > only_b.len() { &a.agent } else { &b.agent };
        match *p_value <= ALPHA {
            true if a.agent == b.agent => format!("{p}: significant difference."),
            true => format!("{p}: significant difference, in favour of {better}."),
            false => format!("{p}: no significant difference."),
        }
    }

    /// Returns both runs: number, identifier and name of the place.
    fn runs(&self) -> [(usize, &str, &'static str); 2] {
        [(0, &self.told.a.run, "First run"), (1, &self.told.b.run, "Second run")]
    }

    /// Returns whether a run has a build for a task.
    fn has_build(&self, run: usize, number: u32) -> bool {
        !self.unanswered[run].contains(&number)
    }

    /// Returns where to look at a task: at both builds, or at the only one.
    fn link(&self, number: u32) -> String {
        let Comparison { a, b, .. } = &self.told;
        match (self.has_build(0, number), self.has_build(1, number)) {
            (true, true) => format!("/compare?run_a={}&run_b={}&task={number}", a.run, b.run),
            (true, false) => format!("/runs/{}/tasks/{number}", a.run),
            (false, _) => format!("/runs/{}/tasks/{number}", b.run),
        }
    }

    /// Returns each agent with the tasks that it alone solves: those that are shown with builds, and the others.
    fn sides(&self) -> [(&str, &[ComparedTask], &[ComparedTask]); 2] {
        let Comparison { a, b, only_a, only_b, .. } = &self.told;
        let split = |tasks: &'_ [ComparedTask]| tasks.len().min(WITH_BUILDS);
        let (at_a, at_b) = (split(only_a), split(only_b));
        [(&a.agent, &only_a[..at_a], &only_a[at_a..]), (&b.agent, &only_b[..at_b], &only_b[at_b..])]
    }
}

/// Serves the page that compares two runs of a board.
///
/// # Errors
/// Returns a 404 error if the suite does not exist or its board has no such run.
pub async fn compare_runs(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    RawQuery(raw): RawQuery,
) -> PageResult {
    let two: Two = params::read(&html::set_fields(raw.as_deref()))?;
    let told = compare(&state, &suite, &two.a, &two.b).await?;
    let figure = dumbbells::draw(&told.a, &told.b);
    let tasks = &told.board.entry.suite.tasks;
    let unanswered = [&told.a, &told.b].map(|run| {
        let left = tasks.iter().enumerate().filter(|(place, _)| !run.outcomes.is_answered(*place));
        left.map(|(_, task)| task.number).collect()
    });
    html::page(&ComparePage { suite: told.board.entry.id.clone(), figure, unanswered, told: told.into() })
}

/// Serves the criteria of two runs as CSV.
///
/// # Errors
/// Returns a 404 error if the suite does not exist or its board has no such run.
pub async fn table(State(state): State<AppState>, Path(suite): Path<String>, RawQuery(raw): RawQuery) -> PageResult {
    let two: Two = params::read(&html::set_fields(raw.as_deref()))?;
    let told = compare(&state, &suite, &two.a, &two.b).await?;
    Ok(csv(&dumbbells::draw(&told.a, &told.b))?)
}

/// Serves the criteria of two runs as an SVG file.
///
/// # Errors
/// Returns a 404 error if the suite does not exist or its board has no such run.
pub async fn picture(State(state): State<AppState>, Path(suite): Path<String>, RawQuery(raw): RawQuery) -> PageResult {
    let two: Two = params::read(&html::set_fields(raw.as_deref()))?;
    let told = compare(&state, &suite, &two.a, &two.b).await?;
    Ok(svg(dumbbells::draw(&told.a, &told.b).svg))
}
