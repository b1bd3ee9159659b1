//! News of a board: finished runs and actions on rows.

use std::sync::Arc;

use super::cache::Board;
use crate::store::boards::ActionRow;
use plumbline_engine::grading::standings::Standing;

/// Maximum number of news.
const MAX_NEWS: usize = 100;

/// Something new on a board.
#[derive(Debug)]
pub enum News {
    /// A run finished.
    Finished(Arc<Standing>),
    /// An operator acted on a row.
    Acted(ActionRow),
}

impl News {
    /// Returns a name that no other news has.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Finished(row) => format!("run:{}", row.run),
            Self::Acted(action) => format!("board-action:{}", action.id),
        }
    }

    /// Returns the time of the news, in milliseconds since 1970.
    #[must_use]
    pub fn at_ms(&self) -> i64 {
        match self {
            Self::Finished(row) => row.finished_at_ms,
            Self::Acted(action) => action.at_ms,
        }
    }
}

/// Returns the news of a board, latest first.
#[must_use]
pub fn news(board: &Board) -> Vec<News> {
    let finished = board.rows.all.iter().cloned().map(News::Finished);
    let mut news: Vec<News> = finished.chain(board.actions.iter().cloned().map(News::Acted)).collect();
    news.sort_by(|a, b| b.at_ms().cmp(&a.at_ms()).then_with(|| a.name().cmp(&b.name())));
    news.truncate(MAX_NEWS);
    news
}
