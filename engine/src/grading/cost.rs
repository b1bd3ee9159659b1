//! Estimates what grading costs at most, from the checks and the size of the log. The estimate decides where grading is
//! done, never its result.
//!
//! The figures are upper bounds in nanoseconds, on the slower of the machines at hand. They come from
//! `tests/bench/worst_checks.rs`, which runs each check on builds that are designed to be hard for it.

use crate::checks::Check;
use crate::tasks::Task;
use crate::voxel::terrain::MAX_EXTENT;
use crate::voxel::{BlockLog, Bounds, Event};

/// Class of grading by its cost, which decides where it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cost {
    /// Takes less than two milliseconds.
    Immediate,
    /// Takes up to about half a second.
    Short,
    /// May take longer.
    Long,
}

/// Greatest estimate of immediate grading.
const IMMEDIATE_NS: u64 = 2_000_000;
/// Greatest estimate of short grading.
const SHORT_NS: u64 = 500_000_000;
/// Replaying an event and adding it to the structure of a turn.
const REPLAY_NS: u64 = 200;
/// Reading an entry as the game does, which finds the halves of doors and beds.
const READ_NS: u64 = 300;
/// Fixed cost of a check, for writing its finding.
const FINDING_NS: u64 = 2_000;
/// One byte of a name, in checks that compare names.
const NAME_NS: u64 = 50;
/// One cell of the space around a build, once for all checks of a turn that look at the air in it.
const AIR_NS: u64 = 30;
/// The same, for each check that also walks through it.
const WALK_NS: u64 = 50;
/// The same, for each check that only looks at the air.
const LOOK_NS: u64 = 5;

/// Estimates what grading a log against a task costs at most.
#[must_use]
pub fn cost(task: &Task, log: &BlockLog) -> Cost {
    let ns = nanoseconds(task, log);
    if ns <= IMMEDIATE_NS {
        Cost::Immediate
    } else if ns <= SHORT_NS {
        Cost::Short
    } else {
        Cost::Long
    }
}

fn nanoseconds(task: &Task, log: &BlockLog) -> u64 {
    let mut blocks = 0;
    let mut sum = 0_u64;
    let mut space = None;
    // Checks of names look at each name, some of them once for each name that they ask for.
    let names: u64 = log.palette.names().map(|name| name.len() as u64 + 1).sum();
    for (turn, instruction) in task.turns.iter().enumerate() {
        // No more blocks can stand than were placed.
        blocks += log.turns.get(turn).map_or(0, |events| events.len() as u64);
        sum += blocks * if task.reading.is_as_listed() { REPLAY_NS } else { REPLAY_NS + READ_NS };
        let mut air = AIR_NS;
        for check in instruction.checks.iter().chain(&instruction.informational) {
            let own = match per_block_ns(check) {
                PerBlock::Flat(ns) => (blocks * ns + names * NAME_NS) * asked_names(check),
                PerBlock::Space(ns) => {
                    *space.get_or_insert_with(|| walked_cells(log)) * (ns + std::mem::take(&mut air))
                }
            };
            sum = sum.saturating_add(own + FINDING_NS);
        }
        if sum > SHORT_NS {
            break;
        }
    }
    sum
}

/// Counts the cells of the space around everything that a log places.
fn walked_cells(log: &BlockLog) -> u64 {
    let placed = log.turns.iter().flatten().filter(|event| matches!(event, Event::Place { .. })).map(Event::cell);
    let Some(bounds) = Bounds::of(placed) else { return 0 };
    // The space begins at the ground, wherever the build does. No terrain is made for a larger build.
    let [x, _, z] = bounds.extent();
    let height = i64::from(bounds.max.y.max(0));
    [x, height, z].iter().map(|extent| (extent.min(&MAX_EXTENT) + 5) as u64).product()
}

/// Returns how many names a check asks for, one after another.
fn asked_names(check: &Check) -> u64 {
    let asked = match check {
        Check::LayersFollow(rule) => rule.layers.len(),
        Check::MaterialSequenceOrder(rule) => rule.material_sequence.len(),
        Check::Adjacent(rule) => rule.materials.len(),
        _ => 1,
    };
    asked.max(1) as u64
}

enum PerBlock {
    Flat(u64),
    /// The cost depends on the space around the build, not on its blocks.
    Space(u64),
}

const fn per_block_ns(check: &Check) -> PerBlock {
    PerBlock::Flat(match check {
        Check::EnclosedRooms(rule) if rule.max_step.is_some() => return PerBlock::Space(WALK_NS),
        Check::Ceilings(rule) if rule.max_step.is_some() => return PerBlock::Space(WALK_NS),
        Check::EnclosedRooms(_) | Check::DoorsLeadThrough(_) | Check::Ceilings(_) => return PerBlock::Space(LOOK_NS),
        Check::MadeOf(rule) if rule.is_of_rooms() => return PerBlock::Space(LOOK_NS),
        Check::WalksOut(_) | Check::ClimbsTo(_) | Check::UpperFloor(_) => return PerBlock::Space(WALK_NS),
        Check::StressScore(_) => 400_000,
        Check::EquilibriumScore(_) => 100_000,
        Check::HasExit(rule) => 300 + 200 * rule.work(),
        Check::HasWideExit(rule) => 300 + 200 * rule.work(),
        Check::HasRooms(_) | Check::SingleLevel(_) => 10_000,
        Check::Vault(rule) if rule.shell => 10_000,
        Check::ClustersAtYHaveMinSpan(_) | Check::ReachableByStairs(_) => 1_000,
        Check::TopSurfaceConcave(_) | Check::BottomSurfaceConcave(_) | Check::Vault(_) => 500,
        _ => 200,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::Instruction;
    use crate::voxel::Cell;
    use serde_json::json;

    fn task(name: &str, args: &serde_json::Value, checks: usize, turns: usize) -> Task {
        let check: Check = serde_json::from_value(json!({ "fn": name, "args": args })).unwrap();
        let turn = Instruction::new(String::new(), vec![check; checks]);
        Task::foreign("cost/test".to_owned(), 0, vec![turn; turns])
    }

    fn log(blocks: i32, apart: i32) -> BlockLog {
        let mut log = BlockLog { turns: vec![Vec::new()], ..BlockLog::default() };
        for i in 0..blocks {
            log.add_event(0, Cell::new(i * apart, i % 100, 0), Some("stone"));
        }
        log
    }

    #[test]
    fn cost_is_by_checks_and_blocks_and_not_by_events_alone() {
        let exits = json!({ "width": 2, "depth": 1, "height": 2 });
        let exit = |checks, turns| task("shape.has_exit", &exits, checks, turns);
        assert_eq!(cost(&exit(1, 1), &log(1_000, 1)), Cost::Immediate);
        assert_eq!(cost(&exit(64, 1), &log(1_000, 1)), Cost::Short);
        assert_eq!(cost(&exit(64, 64), &log(1_000, 1)), Cost::Long, "two such requests stopped the service");
        let wide = json!({ "width": 16, "depth": 16, "height": 16 });
        assert_eq!(cost(&task("shape.has_exit", &wide, 1, 1), &log(1_000, 1)), Cost::Short);
    }

    #[test]
    fn lists_and_names_cost_too() {
        let long: Vec<String> = (0..5_000).map(|i| format!("material {i}")).collect();
        let order = task("dependency.material_sequence_order", &json!({ "material_sequence": long }), 1, 1);
        assert_eq!(cost(&order, &log(1_000, 1)), Cost::Long);
        let mut named = log(10, 1);
        for i in 0..4_000 {
            named.add_event(0, Cell::new(i, 1, 0), Some(&format!("{i:0>128}")));
        }
        let adjacent = task("shape.are_adjacent", &json!({ "materials": ["stone", "glass"] }), 1, 1);
        assert_eq!(cost(&adjacent, &named), Cost::Short);
    }

    #[test]
    fn what_walks_costs_by_space_and_stress_by_blocks() {
        let rooms = task("shape.has_enclosed_rooms", &json!({ "min_rooms": 1 }), 1, 1);
        assert_eq!(cost(&rooms, &log(10, 1)), Cost::Immediate);
        assert_eq!(cost(&rooms, &log(120, 1)), Cost::Short);
        let stress = task("structural_stability.stress_score", &json!({ "von_mises_stress": 1.0 }), 1, 1);
        assert_eq!(cost(&stress, &log(2, 1)), Cost::Immediate);
        assert_eq!(cost(&stress, &log(500, 1)), Cost::Short);
        assert_eq!(cost(&stress, &log(5_000, 1)), Cost::Long);
    }
}
