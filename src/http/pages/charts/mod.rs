//! Charts of a board: each is an SVG file with a table of its numbers.

mod cost;
mod drawing;
pub mod dumbbells;
pub mod figure;
mod intervals;
mod matrix;
mod profile;
mod progress;
mod runs;

use askama::Template;
use axum::extract::{Path, RawQuery, State};
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse as _, Response};

use self::figure::Figure;
use self::runs::{Charted, ChartsQuery};
use super::html::{self, PageResult};
use crate::app::error::{AppError, AppResult};
use crate::http::extract::params;
use crate::http::state::AppState;
use plumbline_engine::tasks::Track;

/// Draws a chart.
type Draw = fn(&Charted) -> Option<Figure>;

/// All charts by their names, in the order of the page.
const CHARTS: [(&str, Draw); 5] = [
    ("intervals", intervals::draw),
    ("cost", cost::draw),
    ("progress", progress::draw),
    ("profile", profile::draw),
    ("matrix", matrix::draw),
];

/// A chart on the page.
struct Shown {
    name: &'static str,
    figure: Figure,
}

#[derive(Template)]
#[template(path = "charts/charts.html")]
struct ChartsPage {
    suite: String,
    track: Track,
    tracks: &'static [Track],
    as_of: Option<String>,
    agent: Option<String>,
    /// The query that selects the same runs, for links.
    query: String,
    charts: Vec<Shown>,
}

/// Serves the charts of a board, each with its numbers.
///
/// # Errors
/// Returns a 404 error if the suite does not exist and a 400 error if a parameter is invalid.
pub async fn charts(State(state): State<AppState>, Path(suite): Path<String>, RawQuery(raw): RawQuery) -> PageResult {
    let query: ChartsQuery = params::read(&html::set_fields(raw.as_deref()))?;
    let charted = Charted::read(&state, &suite, &query).await?;
    let draw = |(name, draw): (&'static str, Draw)| Some(Shown { name, figure: draw(&charted)? });
    html::page(&ChartsPage {
        suite: charted.board.entry.id.clone(),
        track: charted.track,
        tracks: charted.board.entry.suite.tracks(),
        charts: CHARTS.into_iter().filter_map(draw).collect(),
        query: query.as_link(charted.track),
        as_of: query.as_of,
        agent: query.agent,
    })
}

/// Serves a chart as an SVG file, or its numbers as CSV.
///
/// # Errors
/// Returns a 404 error if there is no such suite or chart, or nothing to draw, and a 400 error if a parameter is
/// invalid.
pub async fn file(
    State(state): State<AppState>,
    Path((suite, file)): Path<(String, String)>,
    RawQuery(raw): RawQuery,
) -> PageResult {
    let (name, kind) = file.rsplit_once('.').unwrap_or((&file, ""));
    let Some((_, draw)) = CHARTS.iter().find(|(known, _)| *known == name && ["svg", "csv"].contains(&kind)) else {
        let names: Vec<&str> = CHARTS.iter().map(|(name, _)| *name).collect();
        let detail = format!("there is no chart {file:?}: expected one of {}, with .svg or .csv", names.join(", "));
        return Err(AppError::not_found(detail).into());
    };
    let query: ChartsQuery = params::read(&html::set_fields(raw.as_deref()))?;
    let charted = Charted::read(&state, &suite, &query).await?;
    let drawn =
        tokio::task::spawn_blocking(move || draw(&charted)).await.map_err(|error| AppError::internal(&error))?;
    let figure =
        drawn.ok_or_else(|| AppError::not_found(format!("no run of {suite} has what the chart {name} shows")))?;
    Ok(match kind {
        "svg" => svg(figure.svg),
        _ => csv(&figure)?,
    })
}

/// Builds the response for the numbers of a chart.
///
/// # Errors
/// Returns an error if the table cannot be written.
pub fn csv(figure: &Figure) -> AppResult<Response> {
    Ok(([(header::CONTENT_TYPE, "text/csv; charset=utf-8")], figure.csv()?).into_response())
}

/// Builds the response for a chart. Its policy lets it have the style that it carries, and load nothing.
pub fn svg(text: String) -> Response {
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("image/svg+xml")),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static("default-src 'none'; style-src 'unsafe-inline'")),
        (header::CACHE_CONTROL, HeaderValue::from_static("public, max-age=60")),
    ];
    (headers, text).into_response()
}
