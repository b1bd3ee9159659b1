//! Boards in memory: only new results are read after the first time; rows are sorted, filtered and compared on demand.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::{Arc, LazyLock, Mutex, OnceLock, PoisonError, RwLock};
use std::time::{Duration, Instant};

use uuid::Uuid;

use crate::app::blocking::blocking;
use crate::app::error::AppResult;
use crate::store::Store;
use crate::store::boards::{ActionRow, BoardCursor, BoardUpdate, Revealed};
use plumbline_engine::grading::standings::{Field, Standing, order};
use plumbline_engine::grading::statistics::ranks::{Comparisons, RankRange};
use plumbline_engine::tasks::Track;
use plumbline_engine::tasks::catalogue::Entry;

/// Time for which a board counts as current if nothing in this process has changed it. Another process on the same file
/// may have ended a run.
const CURRENT_FOR: Duration = Duration::from_secs(1);

/// Greatest number of withdrawn runs that a board lists.
pub const MAX_WITHDRAWN: usize = 100;

/// Greatest number of earlier states of a board that are kept.
const MAX_EARLIER: usize = 8;

/// Cache of the requested boards.
#[derive(Debug, Default)]
pub struct Boards {
    kept: RwLock<HashMap<String, Kept>>,
    /// Allows one reader at a time, so that new rows are read once however many requests wait for them.
    reading: tokio::sync::Mutex<()>,
}

#[derive(Debug, Clone)]
struct Kept {
    board: Arc<Board>,
    runs_ended: u64,
    since: Instant,
}

/// Rows of a board, best first, with the comparisons between them.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// Rows that cover enough of the suite to be compared.
    pub all: Vec<Arc<Standing>>,
    /// Rows that do not, listed separately.
    pub incomplete: Vec<Arc<Standing>>,
    comparisons: Comparisons,
    threshold: f64,
}

impl Rows {
    /// Creates the rows of a changed board, and reuses the comparisons of rows that both have. Rows that cover less
    /// than `least_coverage` of the suite are listed separately.
    fn changed_to(&self, rows: Vec<Arc<Standing>>, field: &Field, least_coverage: f64) -> Self {
        let (mut rows, mut incomplete): (Vec<_>, Vec<_>) = rows.into_iter().partition(|row| row.covers(least_coverage));
        order(&mut incomplete);
        let is_in = |rows: &[Arc<Standing>]| rows.iter().map(Arc::as_ptr).collect::<HashSet<_>>();
        let (before, after) = (is_in(&self.all), is_in(&rows));
        let (mut compared, gone): (Vec<_>, Vec<_>) =
            self.all.iter().cloned().partition(|row| after.contains(&Arc::as_ptr(row)));
        let mut comparisons = self.comparisons.clone();
        for (i, row) in gone.iter().enumerate() {
            field.count(&mut comparisons, row, &compared, false);
            field.count(&mut comparisons, row, &gone[..i], false);
        }
        for row in rows.iter().filter(|row| !before.contains(&Arc::as_ptr(row))) {
            field.count(&mut comparisons, row, &compared, true);
            compared.push(Arc::clone(row));
        }
        order(&mut rows);
        Self { threshold: field.threshold(&comparisons), all: rows, incomplete, comparisons }
    }

    /// Returns the range of ranks that a run may have among these rows.
    #[must_use]
    pub fn places(&self, one: &Standing, field: &Field) -> RankRange {
        field.places(one, &self.all, self.threshold)
    }
}

/// State of the board of a suite.
#[derive(Debug)]
pub struct Board {
    /// Identifier of this state of the board; whatever is computed from boards with the same version is the same.
    pub version: String,
    /// Suite of the board.
    pub entry: Arc<Entry>,
    /// Facts about the tasks that comparisons need.
    pub field: Arc<Field>,
    /// Share of the suite that a run must have answered, or skipped on purpose, to be compared.
    pub least_coverage: f64,
    /// Visible rows, best first.
    pub rows: Arc<Rows>,
    /// Actions of operators on rows, in order.
    pub actions: Vec<ActionRow>,
    /// Results of each run, in the order in which they took effect.
    results: HashMap<String, Vec<Arc<Standing>>>,
    /// Runs of other owners that are near-identical to a run.
    similar: HashMap<String, BTreeSet<String>>,
    /// Number of runs that each agent has begun.
    begun: HashMap<String, usize>,
    /// Number of compared runs of each track that solve each task, counted when it is first asked for.
    solvers: OnceLock<HashMap<Track, Vec<usize>>>,
    /// Rows at earlier times that were asked for, by the last change before the time, the latest asked for last.
    earlier: Mutex<Vec<(i64, Arc<Rows>)>>,
    read: BoardCursor,
}

impl Board {
    /// Returns the number of runs that an agent has begun, whatever became of them.
    #[must_use]
    pub fn attempts(&self, agent: &str) -> usize {
        self.begun.get(agent).copied().unwrap_or_default()
    }

    /// Returns the current result of a run, even if its row is hidden.
    #[must_use]
    pub fn standing(&self, run: &str) -> Option<&Arc<Standing>> {
        self.results.get(run)?.last()
    }

    /// Returns the finished runs of other owners whose logs are near-identical to those of a run. Runs without a row
    /// are left out.
    #[must_use]
    pub fn similar_to(&self, run: &str) -> Vec<String> {
        let Some(similar) = self.similar.get(run) else { return Vec::new() };
        let hidden = hidden(&self.actions, i64::MAX);
        similar.iter().filter(|other| !hidden.contains(other.as_str())).cloned().collect()
    }

    /// Returns how many of the runs that a run resembles finished before it: those that it may be a copy of.
    #[must_use]
    pub fn copied_from(&self, run: &Standing, similar: &[String]) -> usize {
        let others = similar.iter().filter_map(|other| self.standing(other));
        others.filter(|other| (other.finished_at_ms, &other.run) < (run.finished_at_ms, &run.run)).count()
    }

    /// Returns the agent of a run, unless the operator has hidden its row: the name may be why.
    #[must_use]
    pub fn shown_name(&self, run: &str) -> Option<&str> {
        let standing = self.standing(run)?;
        let is_shown = !hidden_by_operator(&self.actions, i64::MAX).contains(run);
        is_shown.then_some(standing.agent.as_str())
    }

    /// Returns whether the row of a run is hidden now.
    #[must_use]
    pub fn is_hidden(&self, run: &str) -> bool {
        hidden(&self.actions, i64::MAX).contains(run)
    }

    /// Returns the wanted runs that were withdrawn by a time, latest first, with the action: at most [`MAX_WITHDRAWN`],
    /// without those that the operator has hidden.
    #[must_use]
    pub fn withdrawn(&self, at_ms: i64, is_wanted: impl Fn(&Standing) -> bool) -> Vec<(&Arc<Standing>, &ActionRow)> {
        let hidden = hidden_by_operator(&self.actions, at_ms);
        let is_withdrawal = |it: &&ActionRow| it.action == "withdraw" && it.at_ms <= at_ms;
        let withdrawals = self.actions.iter().rev().filter(is_withdrawal);
        let shown = withdrawals.filter(|it| !hidden.contains(it.run_id.as_str()));
        let rows = shown.filter_map(|action| Some((self.standing(&action.run_id)?, action)));
        rows.filter(|(row, _)| is_wanted(row)).take(MAX_WITHDRAWN).collect()
    }

    /// Returns how many of the compared runs of a track solve each task of the suite.
    #[must_use]
    pub fn solvers(&self, track: Track) -> &[usize] {
        let count = || {
            let mut solvers: HashMap<Track, Vec<usize>> = HashMap::new();
            for row in &self.rows.all {
                let of_track = solvers.entry(row.track).or_insert_with(|| vec![0; row.outcomes.len()]);
                for (place, count) in of_track.iter_mut().enumerate() {
                    *count += usize::from(row.outcomes.is_solved(place));
                }
            }
            for track in Track::ALL {
                solvers.entry(track).or_insert_with(|| vec![0; self.entry.suite.tasks.len()]);
            }
            solvers
        };
        &self.solvers.get_or_init(count)[&track]
    }

    /// Returns the runs that were visible at a time and cover enough to be compared, best first, without comparing
    /// them.
    #[must_use]
    pub fn ordered_at(&self, at_ms: i64) -> Vec<Arc<Standing>> {
        let mut rows = self.showing(at_ms);
        rows.retain(|row| row.covers(self.least_coverage));
        order(&mut rows);
        rows
    }

    /// Returns the rows that were visible at a time, best first. Comparing thousands of runs anew takes a second, so
    /// the last states that were asked for are kept.
    #[must_use]
    pub fn as_of(&self, at_ms: i64) -> Arc<Rows> {
        let since = self.last_change(at_ms);
        if since == self.last_change(i64::MAX) {
            return Arc::clone(&self.rows);
        }
        if let Some(rows) = self.kept(since) {
            return rows;
        }
        let rows = Arc::new(Rows::default().changed_to(self.showing(at_ms), &self.field, self.least_coverage));
        let mut earlier = self.earlier.lock().unwrap_or_else(PoisonError::into_inner);
        earlier.truncate(MAX_EARLIER - 1);
        earlier.insert(0, (since, Arc::clone(&rows)));
        rows
    }

    /// Returns whether the rows at a time are at hand.
    #[must_use]
    pub fn is_at_hand(&self, at_ms: i64) -> bool {
        let since = self.last_change(at_ms);
        since == self.last_change(i64::MAX) || self.kept(since).is_some()
    }

    fn kept(&self, since: i64) -> Option<Arc<Rows>> {
        let earlier = self.earlier.lock().unwrap_or_else(PoisonError::into_inner);
        earlier.iter().find(|(known, _)| *known == since).map(|(_, rows)| Arc::clone(rows))
    }

    /// Returns the time of the last change of the board up to a time.
    fn last_change(&self, at_ms: i64) -> i64 {
        let results = self.results.values().flatten().map(|result| result.since_ms);
        let changes = results.chain(self.actions.iter().map(|action| action.at_ms));
        changes.filter(|change| *change <= at_ms).max().unwrap_or(i64::MIN)
    }

    fn showing(&self, at_ms: i64) -> Vec<Arc<Standing>> {
        let hidden = hidden(&self.actions, at_ms);
        self.results
            .values()
            .filter_map(|results| results.iter().rev().find(|result| result.since_ms <= at_ms))
            .filter(|result| !hidden.contains(result.run.as_str()))
            .cloned()
            .collect()
    }

    fn with(self: &Arc<Self>, news: BoardUpdate) -> Arc<Self> {
        if news.read == self.read {
            return Arc::clone(self);
        }
        let (mut results, mut actions, mut begun) = (self.results.clone(), self.actions.clone(), self.begun.clone());
        let mut similar = self.similar.clone();
        for finished in news.results {
            let standing = Arc::new(Standing::of(&self.field, finished));
            note_similar(&mut similar, &results, &standing);
            results.entry(standing.run.clone()).or_default().push(standing);
        }
        actions.extend(news.actions);
        for Revealed { run_id, alias, agent } in news.revealed {
            for standing in results.get_mut(&run_id).into_iter().flatten() {
                *standing = Arc::new(standing.revealed(&agent));
            }
            if let Some(standing) = results.get(&run_id).and_then(|results| results.last()) {
                note_similar(&mut similar, &results, standing);
            }
            // The run was counted under its alias.
            if let Some(count) = begun.get_mut(&alias) {
                *count = count.saturating_sub(1);
            }
            *begun.entry(agent).or_default() += 1;
        }
        for agent in news.begun {
            *begun.entry(agent).or_default() += 1;
        }
        let mut board = Self {
            version: version(&self.entry, news.read),
            entry: Arc::clone(&self.entry),
            field: Arc::clone(&self.field),
            least_coverage: self.least_coverage,
            rows: Arc::default(),
            actions,
            results,
            similar,
            begun,
            solvers: OnceLock::new(),
            earlier: Mutex::default(),
            read: news.read,
        };
        board.rows = Arc::new(self.rows.changed_to(board.showing(i64::MAX), &self.field, self.least_coverage));
        Arc::new(board)
    }
}

/// Records which runs a new one resembles, in both directions. Whether an anonymous run is like a run of another owner
/// is told only after its embargo: it would say whose it is not.
fn note_similar(
    similar: &mut HashMap<String, BTreeSet<String>>,
    results: &HashMap<String, Vec<Arc<Standing>>>,
    new: &Standing,
) {
    if new.anonymous_until_ms.is_some() {
        return;
    }
    let others = results.values().filter_map(|results| results.last());
    let others = others.filter(|other| other.run != new.run && other.anonymous_until_ms.is_none());
    for other in others.filter(|other| new.resembles(other)) {
        similar.entry(new.run.clone()).or_default().insert(other.run.clone());
        similar.entry(other.run.clone()).or_default().insert(new.run.clone());
    }
}

/// Returns the runs whose rows are hidden at a time, by the operator or because they are withdrawn, which is for good.
fn hidden(actions: &[ActionRow], at_ms: i64) -> HashSet<&str> {
    let mut hidden = hidden_by_operator(actions, at_ms);
    let is_withdrawal = |it: &&ActionRow| it.action == "withdraw" && it.at_ms <= at_ms;
    hidden.extend(actions.iter().filter(is_withdrawal).map(|action| action.run_id.as_str()));
    hidden
}

/// Returns the runs that the operator has hidden at a time.
fn hidden_by_operator(actions: &[ActionRow], at_ms: i64) -> HashSet<&str> {
    let mut hidden = HashSet::new();
    for action in actions.iter().filter(|action| action.at_ms <= at_ms) {
        match action.action.as_str() {
            "hide" => {
                hidden.insert(action.run_id.as_str());
            }
            "restore" => {
                hidden.remove(action.run_id.as_str());
            }
            _ => {}
        }
    }
    hidden
}

impl Boards {
    /// Returns the board of a suite as it is now.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub(super) async fn of(&self, store: &Store, least_coverage: f64, entry: &Arc<Entry>) -> AppResult<Arc<Board>> {
        let suite_id = entry.id.as_str();
        if let Some(board) = self.current(store, suite_id) {
            return Ok(board);
        }
        let _alone = self.reading.lock().await;
        if let Some(board) = self.current(store, suite_id) {
            return Ok(board);
        }
        let runs_ended = store.runs_ended();
        let known = self.kept.read().unwrap_or_else(PoisonError::into_inner).get(suite_id).cloned();
        let board = known.map_or_else(|| Arc::new(empty(entry, least_coverage)), |kept| kept.board);
        let news = store.board_update(suite_id, &entry.suite.tasks, board.read).await?;
        // Each new row is compared with all others, which takes a while for thousands of them.
        let board = blocking(move || Ok(board.with(news))).await?;
        let kept = Kept { board: Arc::clone(&board), runs_ended, since: Instant::now() };
        self.kept.write().unwrap_or_else(PoisonError::into_inner).insert(suite_id.to_owned(), kept);
        Ok(board)
    }

    fn current(&self, store: &Store, suite_id: &str) -> Option<Arc<Board>> {
        let all = self.kept.read().unwrap_or_else(PoisonError::into_inner);
        let kept = all.get(suite_id)?;
        let is_current = kept.runs_ended == store.runs_ended() && kept.since.elapsed() < CURRENT_FOR;
        is_current.then(|| Arc::clone(&kept.board))
    }
}

/// Returns the rows that the board of a suite compares, best first, from all that the database tells of it.
#[must_use]
pub fn compared(entry: &Arc<Entry>, least_coverage: f64, all: BoardUpdate) -> Vec<Arc<Standing>> {
    Arc::new(empty(entry, least_coverage)).with(all).rows.all.clone()
}

fn version(entry: &Entry, BoardCursor { result, action, run }: BoardCursor) -> String {
    // Include the process: another program, or another database under the same name, may compute something else.
    static PROCESS: LazyLock<Uuid> = LazyLock::new(Uuid::new_v4);
    format!("{}:{result}:{action}:{run}:{}", entry.id, *PROCESS)
}

fn empty(entry: &Arc<Entry>, least_coverage: f64) -> Board {
    Board {
        version: version(entry, BoardCursor::default()),
        field: Arc::new(Field::of(&entry.suite.tasks)),
        least_coverage,
        entry: Arc::clone(entry),
        rows: Arc::default(),
        actions: Vec::new(),
        results: HashMap::new(),
        similar: HashMap::new(),
        begun: HashMap::new(),
        solvers: OnceLock::new(),
        earlier: Mutex::default(),
        read: BoardCursor::default(),
    }
}
