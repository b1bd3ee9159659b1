//! The runs that charts show.

use std::collections::HashMap;
use std::sync::Arc;

use serde::Deserialize;

use crate::app::App;
use crate::app::boards::cache::Board;
use crate::app::boards::leaderboard::moment;
use crate::app::boards::read;
use crate::app::cards::card::Cost;
use crate::app::cards::of_runs;
use crate::app::error::{AppError, AppResult};
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::tasks::Track;

/// Greatest number of runs that a chart shows: the best.
const MAX_RUNS: usize = 500;

/// Query of the charts of a board.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChartsQuery {
    /// Track of the prompts; the track of the best run by default.
    pub track: Option<Track>,
    /// Time at which to show the board.
    pub as_of: Option<String>,
    /// Only runs of this agent, by its whole name.
    pub agent: Option<String>,
}

impl ChartsQuery {
    /// Returns the query that selects the same runs, of the track that is shown.
    pub fn as_link(&self, track: Track) -> String {
        let mut query = form_urlencoded::Serializer::new(String::new());
        query.append_pair("track", track.name());
        for (name, value) in [("as_of", &self.as_of), ("agent", &self.agent)] {
            query.extend_pairs(value.as_ref().map(|value| (name, value)));
        }
        query.finish()
    }
}

/// Runs of one track of a board, best first, with their declared costs.
pub struct Charted {
    /// The board.
    pub board: Arc<Board>,
    /// Track of the runs.
    pub track: Track,
    /// The runs: those that are compared.
    pub runs: Vec<Arc<Standing>>,
    costs: HashMap<String, Cost>,
}

impl Charted {
    /// Reads the runs that a query selects.
    ///
    /// # Errors
    /// Returns an error if there is no such suite, if a parameter is invalid, or if the database fails.
    pub async fn read(app: &App, suite: &str, query: &ChartsQuery) -> AppResult<Self> {
        let board = read::board(app, suite).await?;
        if let Some(detail) = query.track.and_then(|track| board.entry.suite.lacks(track)) {
            return Err(AppError::wrong_parameter("track", detail));
        }
        let rows = moment(query.as_of.as_deref())?.map(|at| board.ordered_at(at));
        let rows = rows.as_ref().unwrap_or(&board.rows.all);
        let is_wanted = |row: &&Arc<Standing>| query.agent.as_ref().is_none_or(|agent| *agent == row.agent);
        let first = rows.iter().find(is_wanted).map(|row| row.track);
        let track = query.track.or(first).or_else(|| board.entry.suite.tracks().first().copied()).unwrap_or_default();
        let runs = rows.iter().filter(|row| row.track == track).filter(is_wanted).take(MAX_RUNS).cloned();
        let runs: Vec<Arc<Standing>> = runs.collect();
        let names: Vec<&str> = runs.iter().map(|row| row.run.as_str()).collect();
        let costs = of_runs(app, &names).await?.into_iter().filter_map(|(run, card)| Some((run, card.cost?))).collect();
        Ok(Self { board, track, runs, costs })
    }

    /// Returns the declared cost of a run.
    pub fn cost(&self, run: &Standing) -> Option<&Cost> {
        self.costs.get(&run.run)
    }
}
