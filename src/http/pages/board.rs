//! The page of a board and the page that compares two of its runs.

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use serde::Deserialize;

use super::html::{self, PageResult};
use crate::app::error::AppError;
use crate::http::boards::body::{BoardBody, BoardRow};
use crate::http::boards::comparisons::{Breakdown, ComparedTask, Comparison, GroupBy, breakdown, compare};
use crate::http::boards::leaderboard::{BoardQuery, CoverageFilter, Direction, page as rows_of};
use crate::http::extract::params;
use crate::http::state::AppState;
use plumbline_engine::grading::statistics::comparison::fisher;
use plumbline_engine::grading::statistics::ranks::{range, threshold};
use plumbline_engine::tasks::reported::ReportedRow;

/// Columns that a board can be sorted by: key and displayed name.
const COLUMNS: [(&str, &str); 11] = [
    ("overall", "overall"),
    ("accuracy", "accuracy"),
    ("material", "material"),
    ("shape", "shape"),
    ("size", "size"),
    ("physical_plausibility", "plausibility"),
    ("dependency", "dependency"),
    ("structural_stability", "mean stability"),
    ("efficiency", "mean efficiency"),
    ("coverage", "coverage"),
    ("finished", "finished"),
];
/// Number of rows on a page.
const ROWS: u32 = 50;
/// Number of runs in the tables by group.
const GROUPED_ROWS: usize = 8;

struct Column {
    key: &'static str,
    name: &'static str,
    link: String,
}

struct Table {
    title: &'static str,
    rates: Breakdown,
}

struct Reported {
    place: String,
    overall: String,
    means: Vec<String>,
    row: ReportedRow,
}

#[derive(Template)]
#[template(path = "board.html")]
struct BoardPage {
    body: BoardBody,
    incomplete: Vec<BoardRow>,
    columns: Vec<Column>,
    sort: String,
    is_ascending: bool,
    direction: &'static str,
    agent: String,
    as_of: String,
    query_text: String,
    next: Option<String>,
    tables: Vec<Table>,
    reported: Vec<Reported>,
}

impl BoardPage {
    /// Returns whether a row begins a new group: its best possible rank is worse than that of the row before it.
    fn begins_group(&self, row: usize) -> bool {
        let places = |row: usize| self.body.rows.get(row).and_then(|row| row.places);
        let before = row.checked_sub(1).and_then(places);
        self.sort == "overall" && before.zip(places(row)).is_some_and(|(before, own)| own.first > before.first)
    }
}

/// Serves the page of a board.
///
/// # Errors
/// Returns a 404 error if the suite does not exist and a 400 error if a parameter is invalid.
pub async fn board(State(state): State<AppState>, Path(suite): Path<String>, RawQuery(raw): RawQuery) -> PageResult {
    // An empty form field is an unset filter.
    let set: Vec<(String, String)> = form_urlencoded::parse(raw.as_deref().unwrap_or_default().as_bytes())
        .into_owned()
        .filter(|(_, value)| !value.is_empty())
        .collect();
    let filled = form_urlencoded::Serializer::new(String::new()).extend_pairs(set).finish();
    let mut query: BoardQuery = params::read(&filled)?;
    query.limit = query.limit.or(Some(ROWS));
    let entry = state.suite(&suite).await?;
    let board = state.boards.of(&state.store, state.least_coverage, &entry).await?;
    let body = rows_of(&board, &query)?;
    let apart = BoardQuery { coverage: CoverageFilter::Incomplete, after: None, ..query.clone() };
    let incomplete = match query.coverage {
        CoverageFilter::Complete => rows_of(&board, &apart)?.rows,
        CoverageFilter::Incomplete => Vec::new(),
    };
    let raw = raw.unwrap_or_default();
    let named = form_urlencoded::parse(raw.as_bytes()).find(|(name, _)| name == "sort");
    let sort = named.map_or_else(|| "overall".to_owned(), |(_, value)| value.into_owned());
    let is_ascending = query.order == Direction::Asc;
    let filters = {
        let mut filters = form_urlencoded::Serializer::new(String::new());
        for (name, value) in [("agent", &query.agent), ("as_of", &query.as_of)] {
            if let Some(value) = value {
                filters.append_pair(name, value);
            }
        }
        filters.finish()
    };
    let link = |key: &str, ascending: bool| {
        let order = if ascending { "&order=asc" } else { "" };
        format!("/boards/{suite}?sort={key}{order}{}{filters}", if filters.is_empty() { "" } else { "&" })
    };
    let columns = COLUMNS
        .map(|(key, name)| Column { key, name, link: link(key, key == sort && !is_ascending) })
        .into_iter()
        .collect();
    let next = body.next_after.as_ref().map(|after| format!("{}&after={after}", link(&sort, is_ascending)));
    let best: Vec<_> =
        body.rows.iter().take(GROUPED_ROWS).filter_map(|row| board.standing(&row.run)).cloned().collect();
    let tables =
        [("By criterion", GroupBy::Criterion), ("By category", GroupBy::Category), ("By family", GroupBy::Family)]
            .map(|(title, by)| Table { title, rates: breakdown(&board, by, &best) })
            .into_iter()
            .filter(|table| !table.rates.groups.is_empty())
            .collect();
    html::page(&BoardPage {
        reported: reported(&body.reported),
        columns,
        is_ascending,
        direction: if is_ascending { "ascending" } else { "descending" },
        agent: query.agent.unwrap_or_default(),
        as_of: query.as_of.unwrap_or_default(),
        query_text: raw,
        next,
        tables,
        sort,
        incomplete,
        body,
    })
}

/// Ranks the reported rows among each other and formats them for the page.
fn reported(rows: &[ReportedRow]) -> Vec<Reported> {
    let solved = |row: &ReportedRow| row.solved.zip(row.of);
    let known: Vec<(usize, (usize, usize))> =
        rows.iter().enumerate().filter_map(|(i, row)| Some((i, solved(row)?))).collect();
    let p = |one: (usize, usize), other: (usize, usize)| fisher(one.0, one.1, other.0, other.1);
    let pairs = known.iter().enumerate().flat_map(|(i, one)| known[..i].iter().map(move |other| p(one.1, other.1)));
    let level = threshold(pairs.collect());
    let place = |i: usize, row: &ReportedRow| {
        let Some(own) = solved(row) else { return "n/a".to_owned() };
        // Another row may have the same counts.
        let others = known.iter().filter(|(other, _)| *other != i).map(|(_, counts)| *counts);
        html::places(Some(range(others.map(|other| (other.0 * own.1 > own.0 * other.1, p(other, own))), level)))
    };
    let overall = |row: &ReportedRow| match (solved(row), row.overall) {
        (Some((pass, of)), _) => format!("{:.1} % ({pass} of {of})", pass as f64 / of as f64 * 100.0),
        (None, Some(percent)) => format!("about {percent:.0} %"),
        (None, None) => "n/a".to_owned(),
    };
    let mean = |row: &ReportedRow, i: usize| match row.spreads.get(i) {
        Some(spread) => format!("{:.1} ± {spread:.1}", row.means[i]),
        None => format!("{:.1}", row.means[i]),
    };
    let told = |(i, row): (usize, &ReportedRow)| Reported {
        place: place(i, row),
        overall: overall(row),
        means: (0..row.means.len()).map(|i| mean(row, i)).collect(),
        row: row.clone(),
    };
    rows.iter().enumerate().map(told).collect()
}

impl ComparePage {
    fn p_value(&self) -> String {
        html::probability(self.told.p_value)
    }

    /// Returns each agent with the tasks that it alone solves.
    fn sides(&self) -> [(&str, &[ComparedTask]); 2] {
        let Comparison { a, b, only_a, only_b, .. } = &self.told;
        [(&a.agent, only_a), (&b.agent, only_b)]
    }
}

/// The two runs to compare.
#[derive(Debug, Deserialize)]
pub struct Two {
    a: String,
    b: String,
}

#[derive(Template)]
#[template(path = "compare.html")]
struct ComparePage {
    suite: String,
    told: Comparison,
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
    let two: Two = params::read(raw.as_deref().unwrap_or_default())?;
    let entry = state.suite(&suite).await?;
    let board = state.boards.of(&state.store, state.least_coverage, &entry).await?;
    let standing = |run: &str| {
        board.standing(run).ok_or_else(|| AppError::not_found(format!("this board has no finished run {run:?}")))
    };
    html::page(&ComparePage { suite: entry.suite.id(), told: compare(&board, standing(&two.a)?, standing(&two.b)?) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reported_rows_with_the_same_counts_share_their_ranks() {
        let row = |agent: &str, solved| ReportedRow {
            agent: agent.to_owned(),
            solved,
            of: solved.map(|_| 700),
            overall: None,
            means: Vec::new(),
            spreads: Vec::new(),
        };
        let rows = [row("a", Some(300)), row("b", Some(300)), row("c", Some(20)), row("d", None)];
        let places: Vec<String> = reported(&rows).into_iter().map(|row| row.place).collect();
        assert_eq!(places, ["1–2", "1–2", "3", "n/a"]);
    }
}
