//! Finding what a visitor looks for by a text: agents, tasks, suites and epochs, or something by its identifier.

use super::App;
use super::boards::agents::{KnownAgent, agents};
use super::catalogue::tasks::SearchText;
use super::error::AppResult;
use super::hidden::epochs::epochs;

/// Greatest number of results of each kind.
pub const MAX_LISTED: usize = 20;

/// A task that a search finds.
#[derive(Debug)]
pub struct FoundTask {
    /// `name@version` of its suite.
    pub suite: String,
    /// Number of the task in the suite.
    pub number: u32,
    /// Identifier of the task.
    pub id: String,
}

/// What a search finds. Each list has at most [`MAX_LISTED`] entries, and the number of all that match.
#[derive(Debug, Default)]
pub struct Found {
    /// Agents on boards, by name.
    pub agents: (Vec<KnownAgent>, usize),
    /// Tasks of the newest suite that matches any, by number.
    pub tasks: (Vec<FoundTask>, usize),
    /// Suites, by `name@version`.
    pub suites: (Vec<String>, usize),
    /// Epochs, by name.
    pub epochs: (Vec<String>, usize),
    /// Page of the run or the submission whose identifier the text is.
    pub page: Option<String>,
}

/// Finds what contains a text; case is ignored.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn search(app: &App, text: &str) -> AppResult<Found> {
    let text = text.trim();
    if text.is_empty() {
        return Ok(Found::default());
    }
    let pattern = SearchText::new(text);
    let mut entries = app.catalogue().suites().to_vec();
    entries.sort_by_key(|entry| (entry.suite.name.clone(), std::cmp::Reverse(entry.suite.version)));
    let suites = entries.iter().map(|entry| entry.id.clone()).filter(|id| pattern.is_in(id)).collect();
    let names = epochs(app).await?.into_iter().map(|epoch| epoch.row.id().to_owned());
    let of_suite = entries.iter().map(|entry| {
        let suite = entry.id.clone();
        let tasks = entry.suite.tasks.iter().filter(|task| pattern.is_in_task(task));
        let found = |task: &plumbline_engine::tasks::Task| FoundTask {
            suite: suite.clone(),
            number: task.number,
            id: task.id.clone(),
        };
        tasks.map(found).collect::<Vec<_>>()
    });
    Ok(Found {
        agents: first(agents(app, text).await?),
        tasks: first(of_suite.into_iter().find(|tasks| !tasks.is_empty()).unwrap_or_default()),
        suites: first(suites),
        epochs: first(names.filter(|name| pattern.is_in(name)).collect()),
        page: page_of(app, text).await?,
    })
}

/// Returns the page of the run or the submission with this identifier.
async fn page_of(app: &App, id: &str) -> AppResult<Option<String>> {
    if app.store.run(id).await?.is_some() {
        return Ok(Some(format!("/runs/{id}")));
    }
    Ok(app.store.submission(id).await?.map(|row| format!("/submissions/{}", row.id)))
}

fn first<T>(mut all: Vec<T>) -> (Vec<T>, usize) {
    let count = all.len();
    all.truncate(MAX_LISTED);
    (all, count)
}
