//! Stress fields of stored submissions.

use std::sync::Arc;

use super::read;
use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;
use crate::store::submissions::SubmissionRow;
use plumbline_engine::elasticity::field::{Field, Method};
use plumbline_engine::voxel::replay::Replay;
use plumbline_engine::voxel::{BlockLog, Structure};

/// A stress field, with the structure whose blocks it describes.
#[derive(Debug)]
pub struct StressedStructure {
    /// The structure after the turn.
    pub structure: Arc<Structure>,
    /// Stress and displacement of each block, in the order of the structure.
    pub field: Arc<Field>,
}

/// Returns the turn of a submission after which stress is asked for; the last one by default.
///
/// # Errors
/// Returns an error if the log has no such turn.
pub fn turn_of(row: &SubmissionRow, asked: Option<usize>) -> AppResult<usize> {
    let turns = row.turns as usize;
    let turn = asked.unwrap_or(turns);
    if (1..=turns).contains(&turn) {
        return Ok(turn);
    }
    Err(AppError::not_found(format!("there is no turn {turn}; the log has {turns}")))
}

/// Computes the stress field of a stored submission after one of its turns, or returns the cached one.
///
/// # Errors
/// Returns an error if there is no such submission, if it has too many blocks, if computing takes too long, or if too
/// many requests wait.
pub async fn of_submission(
    app: &App,
    who: &Arc<str>,
    row: &SubmissionRow,
    turn: usize,
    method: Method,
) -> AppResult<StressedStructure> {
    let key = (Box::from(row.log_hash.as_str()), turn, method);
    // Admitted before the log is read: with many requests, replaying large logs would itself be too much work.
    let permit = app.stress.admit(&key, who)?;
    let log = read::log(app, &row.id).await?;
    let replaying = tokio::task::spawn_blocking(move || structure_after(&log, turn));
    let structure = Arc::new(replaying.await.map_err(|error| AppError::internal(&error))??);
    let field = app.stress.field(key, &structure, permit, who, &app.stop).await?;
    Ok(StressedStructure { structure, field })
}

/// Returns the structure after a turn.
///
/// # Errors
/// Returns 422 if it has more blocks than stress is computed for.
fn structure_after(log: &[u8], turn: usize) -> AppResult<Structure> {
    let log = BlockLog::from_canonical_json(log).map_err(|error| AppError::damaged("submissions", error))?;
    let structure = Replay::new(&log).nth(turn - 1).unwrap_or_else(|| Structure::from_named([]));
    let (blocks, most) = (structure.len(), LIMITS.blocks_with_stress);
    if blocks > most {
        let detail = format!("{blocks} blocks stand; stress is computed for at most {most}");
        return Err(AppError::new(Kind::TooManyBlocks, detail));
    }
    Ok(structure)
}
