//! Pages of lists.

use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;

/// Returns the number of items on a page: `limit`, or `default` without one.
///
/// # Errors
/// Returns an error (400) if `limit` is out of range.
pub fn page_items(limit: Option<u32>, default: u32) -> AppResult<usize> {
    let items = limit.unwrap_or(default);
    if (1..=LIMITS.page_items).contains(&items) {
        return Ok(items as usize);
    }
    Err(AppError::wrong_parameter("limit", format!("{items} is out of range: 1 to {}", LIMITS.page_items)))
}

/// A page of a stored list.
#[derive(Debug)]
pub struct Page<T> {
    /// Items of the page.
    pub items: Vec<T>,
    /// Whether there is another page.
    pub has_more: bool,
}

impl<T> Page<T> {
    /// Makes a page of at most `items` rows. One more row than that was asked for, to see whether there is another
    /// page.
    #[must_use]
    pub fn of(mut rows: Vec<T>, items: usize) -> Self {
        let has_more = rows.len() > items;
        rows.truncate(items);
        Self { items: rows, has_more }
    }

    /// Returns where the next page begins, derived from the last item; none on the last page.
    pub fn next<N>(&self, position: impl FnOnce(&T) -> N) -> Option<N> {
        self.items.last().filter(|_| self.has_more).map(position)
    }
}
