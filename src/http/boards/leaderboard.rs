//! Leaderboards: one row per finished run of a suite.

use axum::extract::{Path, RawQuery, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;

use super::body::BoardBody;
use super::formats::{Format, render};
use crate::app::boards::leaderboard::{CoverageFilter, Direction, RunsListed, Selection, SortBy, page, prepare};
use crate::app::boards::read;
use crate::app::error::AppResult;
use crate::app::runs::body::RunProvenance;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::tasks::Track;

/// Query of a board: filters, order and page.
#[derive(Debug, Clone, Default, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct BoardQuery {
    /// Value by which the rows are sorted.
    #[serde(default)]
    #[param(inline)]
    pub sort: SortBy,
    /// Sort direction.
    #[serde(default)]
    #[param(inline)]
    pub order: Direction,
    /// Only agents whose name contains this text; case is ignored.
    pub agent: Option<String>,
    /// Only rows with this provenance.
    #[param(inline)]
    pub provenance: Option<RunProvenance>,
    /// Only runs with prompts of this track.
    #[param(inline)]
    pub track: Option<Track>,
    /// Whether to list the runs that cover enough of the suite to be compared, or the other runs.
    #[serde(default)]
    #[param(inline)]
    pub coverage: CoverageFilter,
    /// Whether to list all runs, or the best run of each agent.
    #[serde(default)]
    #[param(inline)]
    pub runs: RunsListed,
    /// Time at which to show the board: RFC 3339, or a date, which stands for the end of that day in UTC.
    pub as_of: Option<String>,
    /// Only rows after the row of this run, for paging.
    #[param(format = Uuid)]
    pub after: Option<String>,
    /// Maximum number of rows on the page.
    #[param(minimum = 1)]
    pub limit: Option<u32>,
    /// Format of the page: `json`, `csv`, `ndjson` or `markdown`.
    #[serde(default)]
    #[param(inline)]
    pub format: Format,
}

impl From<BoardQuery> for Selection {
    fn from(query: BoardQuery) -> Self {
        let BoardQuery { sort, order, agent, provenance, track, coverage, runs, as_of, after, limit, format: _ } =
            query;
        Self { sort, order, agent, provenance, track, coverage, runs, as_of, after, limit }
    }
}

/// Returns the leaderboard of a suite.
///
/// The board has the finished runs, best first unless sorted otherwise, each with the range of ranks that it may have.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}", operation_id = "get_leaderboard", tag = "leaderboards",
    summary = "Get a leaderboard",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), BoardQuery),
    responses(
        (status = 200, description = "A page of the board, in the requested format", content((BoardBody = "application/json",
         example = json!({ "suite": "mineceraft@4", "tasks": 723, "total": 0, "minimum_coverage": 1.0, "incomplete": 0, "rows": [], "next_after": null, "reported": [] })),
         (String = "text/csv", example = "rank,first_place,last_place,run,agent\n"), (String = "application/x-ndjson", example = "{\"rank\":1}\n"), (String = "text/markdown", example = "| Rank | Agent |\n")),
         headers(("ETag" = String, description = "Strong entity tag"))),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
    )
)]
pub async fn get_leaderboard(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    RawQuery(raw): RawQuery,
    Params(query): Params<BoardQuery>,
    asked: HeaderMap,
) -> AppResult<Response> {
    let board = read::board(&state, &suite).await?;
    prepare(&board, query.as_of.as_deref()).await?;
    // The same version of a board and the same query always give the same document.
    let name = ["board:", &board.version, ":", &raw.unwrap_or_default()].concat();
    state.documents.answer(&asked, name, || {
        let format = query.format;
        render(&page(&board, &query.into())?.into(), format)
    })
}
