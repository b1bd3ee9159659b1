//! Verdicts of versions of the suite on builds that are drawn as boxes.

use plumbline_engine::checks::Criterion;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::grade_log;
use plumbline_engine::tasks::{Task, embedded};
use plumbline_engine::voxel::{BlockLog, Cell, Turn};

/// A task of a version without its simulations, which count for no verdict.
pub fn task(version: u32, id: &str) -> Task {
    let suite = embedded::suite(version).unwrap();
    let mut task = suite.tasks.into_iter().find(|task| task.id == id).unwrap();
    for turn in &mut task.turns {
        turn.checks.retain(|check| check.criterion() != Criterion::StructuralStability);
    }
    task
}

/// The first check that a log fails in a version, or `None` if it passes.
pub fn verdict(version: u32, id: &str, log: &BlockLog) -> Option<String> {
    let report = grade_log(&task(version, id), log, &Control::unhurried()).unwrap();
    let failed = report.turns.iter().flat_map(|turn| &turn.checks).find(|check| !check.finding.holds());
    let told = failed.map(|check| format!("{}: {}", check.name, check.finding.summary));
    (!report.overall).then(|| told.unwrap_or_default())
}

/// A material that fills a box from one corner to the other.
pub type Fill<'a> = (&'a str, [i32; 3], [i32; 3]);

/// A log of as many turns, each of which fills boxes.
pub fn built(turns: &[&[Fill<'_>]]) -> BlockLog {
    let mut log = BlockLog::default();
    for fills in turns {
        log.turns.push(Turn::new());
        for (material, a, b) in *fills {
            for (x, y, z) in
                (a[0]..=b[0]).flat_map(|x| (a[1]..=b[1]).flat_map(move |y| (a[2]..=b[2]).map(move |z| (x, y, z))))
            {
                log.place(Cell::new(x, y, z), material);
            }
        }
    }
    log
}
