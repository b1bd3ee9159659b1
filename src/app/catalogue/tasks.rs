//! Tasks of a suite: finding them by filters, by id and by number, and an example build of each.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::app::paging::page_items;
use crate::app::task_ref::near_tasks;
use plumbline_engine::builders::build;
use plumbline_engine::checks::Criterion;
use plumbline_engine::tasks::Task;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::tasks::embedded::FULL;
use plumbline_engine::tasks::family::Category;
use plumbline_engine::text::did_you_mean;
use plumbline_engine::voxel::BlockLog;

/// Filter for listing tasks.
#[derive(Debug, Default)]
pub struct TaskFilter {
    /// Suite of the tasks, as `name` or `name@version`; the full suite by default.
    pub suite: Option<String>,
    /// Family of the tasks.
    pub family: Option<String>,
    /// Category of the tasks.
    pub category: Option<Category>,
    /// Task type of the paper.
    pub kind: Option<String>,
    /// Criterion that applies to the tasks.
    pub criterion: Option<Criterion>,
    /// Text in their ids or instructions.
    pub text: Option<String>,
    /// Number after which the page begins.
    pub after: Option<u32>,
    /// Maximum number of tasks on the page.
    pub limit: Option<u32>,
}

/// A page of the tasks that match a filter.
#[derive(Debug)]
pub struct TaskPage {
    /// Suite of the tasks.
    pub entry: Arc<Entry>,
    /// Number of tasks that match, on all pages.
    pub total: usize,
    /// Number after which the next page begins; none on the last page.
    pub next_after: Option<u32>,
    /// Tasks of the page, by their positions in the suite.
    places: Vec<usize>,
}

impl TaskPage {
    /// Returns the tasks of the page, by number.
    pub fn tasks(&self) -> impl Iterator<Item = &Task> {
        self.places.iter().map(|place| &self.entry.suite.tasks[*place])
    }
}

/// A task and its suite.
#[derive(Debug)]
pub struct FoundTask {
    /// Suite of the task.
    pub entry: Arc<Entry>,
    /// Position of the task in the suite.
    pub place: usize,
}

impl FoundTask {
    /// Returns the task.
    #[must_use]
    pub fn task(&self) -> &Task {
        &self.entry.suite.tasks[self.place]
    }

    /// Returns the SHA-256 of the task's content, in hex.
    #[must_use]
    pub fn hash(&self) -> &str {
        &self.entry.hashes[self.place]
    }
}

/// A text to search for; case is ignored.
#[derive(Debug)]
pub struct SearchText(String);

impl SearchText {
    /// Prepares the search for a text.
    #[must_use]
    pub fn new(text: &str) -> Self {
        Self(text.to_lowercase())
    }

    /// Returns whether a text contains the one to search for.
    #[must_use]
    pub fn is_in(&self, text: &str) -> bool {
        text.to_lowercase().contains(&self.0)
    }

    /// Returns whether the id or an instruction of a task contains the text.
    #[must_use]
    pub fn is_in_task(&self, task: &Task) -> bool {
        self.is_in(&task.id)
            || task
                .turns
                .iter()
                .any(|turn| self.is_in(&turn.prompt) || turn.brief.as_ref().is_some_and(|brief| self.is_in(brief)))
    }
}

/// Lists the tasks of a suite by number, with filters and paging.
///
/// # Errors
/// Returns an error if there is no such suite, if the suite has no task of the family or type, if `limit` is out of
/// range, or if the database fails.
pub async fn list(app: &App, filter: &TaskFilter) -> AppResult<TaskPage> {
    let items = page_items(filter.limit, 100)?;
    let entry = app.suite(filter.suite.as_deref().unwrap_or(FULL)).await?;
    let tasks = &entry.suite.tasks;
    must_be_known("family", filter.family.as_deref(), tasks.iter().map(Task::family))?;
    must_be_known("type", filter.kind.as_deref(), tasks.iter().filter_map(|task| task.kind.as_deref()))?;
    let text = filter.text.as_deref().map(SearchText::new);
    let is_wanted = |place: &usize| {
        let task = &tasks[*place];
        lets_through(filter, task) && text.as_ref().is_none_or(|text| text.is_in_task(task))
    };
    let found: Vec<usize> = (0..tasks.len()).filter(is_wanted).collect();
    let after = filter.after.unwrap_or(0);
    let mut rest = found.iter().copied().filter(|place| tasks[*place].number > after);
    let places: Vec<usize> = rest.by_ref().take(items).collect();
    let next_after = rest.next().and_then(|_| places.last().map(|place| tasks[*place].number));
    Ok(TaskPage { total: found.len(), next_after, places, entry })
}

/// Returns a task by its id. The suite is the full one by default.
///
/// # Errors
/// Returns an error if there is no such suite or task, or if the database fails.
pub async fn with_id(app: &App, suite: Option<&str>, id: &str) -> AppResult<FoundTask> {
    let entry = app.suite(suite.unwrap_or(FULL)).await?;
    let place = entry.task(id).and_then(|(task, _)| place_of(&entry, task.number));
    let Some(place) = place else {
        let near = near_tasks(&entry, id);
        return Err(AppError::not_found(format!("{} has no task {id:?}{near}", entry.id)));
    };
    Ok(FoundTask { entry, place })
}

/// Returns a task by its number in a suite.
///
/// # Errors
/// Returns an error if there is no such suite or task, or if the database fails.
pub async fn numbered(app: &App, suite: &str, number: u32) -> AppResult<FoundTask> {
    let entry = app.suite(suite).await?;
    match place_of(&entry, number) {
        Some(place) => Ok(FoundTask { entry, place }),
        None => Err(AppError::not_found(format!("{} has no task {number}", entry.id))),
    }
}

/// Builds an example for a task.
///
/// # Errors
/// Returns an error if there is no such suite or task, if no builder can build it, or if the database fails.
pub async fn example(app: &App, suite: &str, number: u32) -> AppResult<BlockLog> {
    let found = numbered(app, suite, number).await?;
    build(found.task()).map_err(|error| AppError::not_found(format!("this task has no example build: {error}")))
}

fn place_of(entry: &Entry, number: u32) -> Option<usize> {
    entry.suite.tasks.iter().position(|task| task.number == number)
}

/// Rejects a filter value that occurs nowhere in the suite. It is probably misspelt, and an empty page would hide that.
fn must_be_known<'t>(name: &str, wanted: Option<&str>, known: impl Iterator<Item = &'t str>) -> AppResult<()> {
    let Some(wanted) = wanted else { return Ok(()) };
    let known: BTreeSet<&str> = known.collect();
    if known.contains(wanted) {
        return Ok(());
    }
    let near = did_you_mean(wanted, known.iter().copied());
    let all: Vec<&str> = known.into_iter().collect();
    Err(AppError::wrong_parameter(
        name,
        format!("the suite has no {wanted:?}{near} It has {}", all.join(", ")).replace("\" It", "\". It"),
    ))
}

fn lets_through(filter: &TaskFilter, task: &Task) -> bool {
    filter.family.as_ref().is_none_or(|family| family == task.family())
        && filter.category.is_none_or(|category| task.category == Some(category))
        && filter.kind.as_ref().is_none_or(|kind| task.kind.as_ref() == Some(kind))
        && filter.criterion.is_none_or(|criterion| task.criteria().contains(&criterion))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::tasks::embedded;

    #[test]
    fn a_search_ignores_case_on_both_sides() {
        let mut task = embedded::latest().unwrap().tasks[0].clone();
        task.id = "Walls/Tall-One".to_owned();
        task.turns[0].prompt = "Raise a Wall of STONE".to_owned();
        for text in ["tall-one", "TALL-ONE", "wall of stone", "Wall OF Stone"] {
            assert!(SearchText::new(text).is_in_task(&task), "{text}");
        }
        assert!(!SearchText::new("granite").is_in_task(&task));
    }
}
