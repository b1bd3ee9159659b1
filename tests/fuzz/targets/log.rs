//! Logs in all their forms: what is read without a fault is stored and read back alike.

use plumbline::app::limits::LIMITS;
use plumbline_engine::intake::{Faults, read_turns};
use plumbline_engine::voxel::BlockLog;
use plumbline_engine::voxel::replay::Replay;

pub fn run(data: &[u8]) {
    let mut faults = Faults::new();
    let Ok(Some(log)) = read_turns(data, LIMITS.log(), &mut faults) else { return };
    if !faults.into_list().is_empty() {
        return;
    }
    let stored = log.canonical_json();
    let again = BlockLog::from_canonical_json(&stored).expect("a stored log reads back");
    assert_eq!(again.canonical_json(), stored);
    let built = |log: &BlockLog| Replay::new(log).last().map(|structure| structure.cells().to_vec());
    assert_eq!(built(&again), built(&log));
}
