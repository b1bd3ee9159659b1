//! Task files in the published format: they are refused with a place, or their tasks can be graded.

use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::grade_log;
use plumbline_engine::tasks::published::{TaskFile, read_task_files};
use plumbline_engine::voxel::{BlockLog, Cell, Turn};

/// Greatest number of tasks that are graded.
const MAX: usize = 8;

pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let Ok(tasks) = read_task_files(&[TaskFile { name: "a.json", text }]) else { return };
    for task in tasks.iter().take(MAX) {
        let mut log = BlockLog::default();
        for _ in &task.turns {
            log.turns.push(Turn::new());
            for (x, y) in [(0, 0), (1, 0), (0, 1)] {
                log.place(Cell::new(x, y, 0), "stone");
            }
        }
        assert!(grade_log(task, &log, &Control::unhurried()).is_ok());
    }
}
