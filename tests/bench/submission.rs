//! A submission of the builders' own build, as the store takes it.

use plumbline::store::queue::Lane;
use plumbline::store::submissions::{NewSubmission, PackedLog};
use plumbline_engine::tasks::{Suite, Task};
use plumbline_engine::voxel::{BlockLog, Profile};

/// Returns the submission of a log for a task, without an id.
pub fn submission(suite: &Suite, task: &Task, log: &BlockLog) -> anyhow::Result<NewSubmission> {
    Ok(NewSubmission {
        id: String::new(),
        run_id: None,
        suite_id: suite.id(),
        task_hash: task.content_hash(),
        task_number: task.number,
        log_hash: String::new(),
        turns: log.turns.len(),
        events: log.event_count(),
        owner: Some("bench".to_owned()),
        lane: Lane::Quick,
        log: PackedLog::of(&log.canonical_json())?,
        replays: None,
        profile: Profile::Published,
    })
}
