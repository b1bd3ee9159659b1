//! Repeats on a board: finished runs of one configuration, taken together.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::cache::Board;
use super::read;
use crate::app::App;
use crate::app::error::AppResult;
use plumbline_engine::grading::repeats::Repeats;
use plumbline_engine::grading::standings::Standing;

/// Runs of one owner, agent, track, profile and configuration.
#[derive(Debug)]
pub struct Group {
    /// SHA-256 of the configuration, as the runs' cards declare it.
    pub configuration_hash: String,
    /// The runs, in the order in which they finished.
    pub runs: Vec<Arc<Standing>>,
    /// Figures of all of them.
    pub figures: Repeats,
    /// Number of runs of the group that their owner withdrew.
    pub withdrawn: usize,
}

/// Returns the groups of a board, best first. Runs that cover too little of the suite belong to none.
///
/// # Errors
/// Returns an error if there is no such suite, or if the database fails.
pub async fn repeats(app: &App, suite: &str) -> AppResult<(Arc<Board>, Vec<Group>)> {
    let board = read::board(app, suite).await?;
    let groups = of_board(app, &board).await?;
    Ok((board, groups))
}

/// Returns the groups of a board that was read already, best first.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn of_board(app: &App, board: &Board) -> AppResult<Vec<Group>> {
    let declared = app.store.configurations(&board.entry.id).await?;
    let key_of = |row: &Standing| {
        let configuration = declared.get(&row.run)?.clone();
        Some((row.owner.clone(), row.agent.clone(), row.track.name(), row.profile.clone(), configuration))
    };
    let mut groups: BTreeMap<_, Vec<Arc<Standing>>> = BTreeMap::new();
    for row in &board.rows.all {
        if let Some(key) = key_of(row) {
            groups.entry(key).or_default().push(Arc::clone(row));
        }
    }
    let withdrawn: Vec<_> =
        board.withdrawn(i64::MAX, |_| true).into_iter().filter_map(|(row, _)| key_of(row)).collect();
    let group = |(key, mut runs): (_, Vec<Arc<Standing>>)| {
        runs.sort_by(|a, b| (a.finished_at_ms, &a.run).cmp(&(b.finished_at_ms, &b.run)));
        let figures = Repeats::of(&runs.iter().map(AsRef::as_ref).collect::<Vec<_>>(), &board.field)?;
        let withdrawn = withdrawn.iter().filter(|own| **own == key).count();
        Some(Group { configuration_hash: key.4, runs, figures, withdrawn })
    };
    let mut groups: Vec<Group> = groups.into_iter().filter_map(group).collect();
    groups.sort_by(|a, b| b.figures.mean.total_cmp(&a.figures.mean));
    Ok(groups)
}
