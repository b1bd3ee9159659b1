//! The page of a board.

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use axum::response::{IntoResponse as _, Redirect};

use super::board_links::{Column, Links};
use super::html::{self, PageResult, Preview};
use super::lines::{Line, lines, with_reported};
use crate::app::boards::agents::telling;
use crate::app::boards::breakdown::{GroupBy, of_rows};
use crate::app::boards::cache::Board;
use crate::app::boards::leaderboard::{
    CoverageFilter, Direction, PageStart, RunsListed, Selection, SortBy, page as rows_of, prepare,
};
use crate::app::boards::read;
use crate::app::boards::repeats::of_board;
use crate::app::runs::body::RunProvenance;
use crate::clock::{now_ms, rfc3339};
use crate::http::boards::body::{BoardBody, BoardRow};
use crate::http::boards::comparisons::Breakdown;
use crate::http::boards::formats::Format;
use crate::http::boards::leaderboard::BoardQuery;
use crate::http::boards::repeats::RepeatGroup;
use crate::http::extract::origin::Origin;
use crate::http::extract::params;
use crate::http::state::AppState;
use plumbline_engine::grading::statistics::comparison::fisher;
use plumbline_engine::grading::statistics::ranks::{range, threshold};
use plumbline_engine::tasks::Track;
use plumbline_engine::tasks::reported::ReportedRow;

/// Number of rows on a page.
const ROWS: u32 = 50;
/// Number of runs in the tables by group.
const GROUPED_ROWS: usize = 8;

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
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is an independent choice of the visitor, or says whether a part is shown"
)]
struct BoardPage {
    body: BoardBody,
    lines: Vec<Line>,
    versions: Vec<String>,
    incomplete: Vec<BoardRow>,
    columns: Vec<Column>,
    sort: &'static str,
    is_ascending: bool,
    direction: &'static str,
    agent: String,
    provenance: &'static str,
    track: &'static str,
    tracks: Vec<(&'static str, String)>,
    /// Link to the runs of all tracks.
    any_track: String,
    lists_incomplete: bool,
    is_best_of_agent: bool,
    as_of: String,
    is_filtered: bool,
    previous: Option<String>,
    next: Option<String>,
    /// Query of the charts of the same runs.
    charts: String,
    /// Query of the same rows in the API.
    rows: String,
    /// Link that shows the rows as they are now, whatever is added later, without the origin.
    lasting: String,
    /// Whether the page shows the rows of a time that is over.
    is_past: bool,
    /// Time of the page.
    now: String,
    preview: Preview,
    tables: Vec<Table>,
    has_actions: bool,
    reported: Vec<Reported>,
    repeats: Vec<RepeatGroup>,
}

impl BoardPage {
    /// Returns whether the runs on the page are all prompted alike, so that they can be compared.
    fn is_one_track(&self) -> bool {
        self.body.rows.windows(2).all(|two| two[0].track == two[1].track)
    }

    /// Returns whether a row begins a new group, as it does among the lines.
    fn begins_group(&self, row: usize) -> bool {
        let mut runs = self.lines.iter().filter_map(|line| if let Line::Run(run) = line { Some(run) } else { None });
        self.sort == "overall" && runs.nth(row).is_some_and(|run| run.begins_group)
    }
}

/// Serves the page of a board.
///
/// # Errors
/// Returns a 404 error if the suite does not exist and a 400 error if a parameter is invalid.
pub async fn board(
    State(state): State<AppState>,
    origin: Origin,
    Path(suite): Path<String>,
    RawQuery(raw): RawQuery,
) -> PageResult {
    let set = html::set_fields(raw.as_deref());
    let query: BoardQuery = params::read(&set)?;
    let board = read::board(&state, &suite).await?;
    if query.format != Format::Json {
        // Other formats are those of the API.
        return Ok(Redirect::to(&format!("/v1/leaderboards/{}?{set}", board.entry.id)).into_response());
    }
    let now = rfc3339(now_ms());
    let links = Links::of(&suite, &query);
    let (is_ascending, provenance) = (query.order == Direction::Asc, query.provenance.map_or("", RunProvenance::name));
    let track = query.track.map_or("", Track::name);
    let wanted = Selection { limit: query.limit.or(Some(ROWS)), ..query.into() };
    prepare(&board, wanted.as_of.as_deref()).await?;
    let page = rows_of(&board, &wanted)?;
    let apart = Selection { coverage: CoverageFilter::Incomplete, after: None, ..wanted.clone() };
    let incomplete = match wanted.coverage {
        CoverageFilter::Complete => rows_of(&board, &apart)?.rows,
        CoverageFilter::Incomplete => Vec::new(),
    };
    let best: Vec<_> =
        page.rows.iter().take(GROUPED_ROWS).filter_map(|row| board.standing(&row.standing.run)).cloned().collect();
    let tables =
        [("By criterion", GroupBy::Criterion), ("By category", GroupBy::Category), ("By family", GroupBy::Family)]
            .map(|(title, by)| Table { title, rates: of_rows(&board, by, &best).into() })
            .into_iter()
            .filter(|table| !table.rates.groups.is_empty())
            .collect();
    let is_first = wanted.after.is_none() && wanted.sort == SortBy::Overall && wanted.order == Direction::Desc;
    let mut shown = lines(&state, page.rows.clone()).await?;
    for line in &mut shown {
        if let Line::Run(run) = line {
            run.is_gone = board.is_hidden(&run.row.run);
        }
    }
    let shown = if is_first { with_reported(shown, &page.reported) } else { shown };
    let previous = page.before.as_ref().map(|PageStart(after)| links.page(after.as_deref()));
    let body = BoardBody::from(page);
    let is_shown = |group: &RepeatGroup| wanted.track.is_none_or(|track| track == group.track);
    let repeats = of_board(&state, &board).await?.into_iter().map(RepeatGroup::from).filter(is_shown).collect();
    let name = &board.entry.suite.name;
    let mut versions: Vec<_> = state
        .catalogue()
        .suites()
        .iter()
        .map(|entry| &entry.suite)
        .filter(|suite| suite.name == *name)
        .map(|suite| (suite.version, suite.id()))
        .collect();
    versions.sort_by_key(|(version, _)| std::cmp::Reverse(*version));
    html::page(&BoardPage {
        lines: shown,
        versions: versions.into_iter().map(|(_, id)| id).collect(),
        has_actions: !board.actions.is_empty(),
        repeats,
        reported: reported(&body.reported),
        preview: Preview {
            origin,
            path: format!("/boards/{}", body.suite),
            title: format!("Leaderboard of {}", body.suite),
            image: image_of(&board),
        },
        charts: links.charts(),
        rows: links.rows(),
        lasting: links.lasting(&now),
        is_past: links.is_past(),
        now,
        previous,
        next: body.next_after.as_ref().map(|after| links.page(Some(after))),
        columns: links.columns(),
        sort: links.sort(),
        is_ascending,
        direction: if is_ascending { "ascending" } else { "descending" },
        is_filtered: links.is_filtered(),
        provenance,
        track,
        tracks: board.entry.suite.tracks().iter().map(|track| (track.name(), links.of_track(Some(*track)))).collect(),
        any_track: links.of_track(None),
        is_best_of_agent: wanted.runs == RunsListed::BestOfAgent,
        lists_incomplete: wanted.coverage == CoverageFilter::Incomplete,
        agent: wanted.agent.unwrap_or_default(),
        as_of: wanted.as_of.unwrap_or_default(),
        tables,
        incomplete: incomplete.into_iter().map(BoardRow::from).collect(),
        body,
    })
}

/// Returns the path of a picture that stands for a board: the build of the best run that the fewest others match.
fn image_of(board: &Board) -> Option<String> {
    let best = board.rows.all.first()?;
    let place = *telling(board, best).best.first()?;
    Some(format!("/runs/{}/tasks/{}/preview.png", best.run, board.entry.suite.tasks[place].number))
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
