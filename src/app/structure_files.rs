//! Structure files: as turns of a log, and as what stands after a turn of a stored log.
//!
//! A file tells what stands, not in which order it was built, so checks of planning cannot be measured from files.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::app::event_budget::EventBudget;
use crate::app::limits::LIMITS;
use crate::formats::{self, Build, FileFormat};
use plumbline_engine::checks::Dimension;
use plumbline_engine::game::{Look, Side};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::{SentLog, TurnStructure};
use plumbline_engine::tasks::Task;
use plumbline_engine::text::counted;
use plumbline_engine::voxel::blocks::is_bed;
use plumbline_engine::voxel::cell::{CellMap, CellSet};
use plumbline_engine::voxel::replay::{Replay, events_between};
use plumbline_engine::voxel::{BlockLog, Cell, Profile, Structure, cell};

/// Told where a file cannot be accepted because its task checks the order of blocks.
pub const ORDER_IS_CHECKED: &str = "a structure file does not tell in which order its blocks were placed, and the task \
                                    checks the order; send events, palette and rows, or action_code";

/// Reads the structure files of a log, and adds the events that lead from turn to turn. Faults name the turn.
///
/// # Errors
/// Returns 500 if the work cannot be run.
pub async fn open_files(
    app: &App,
    who: &Arc<str>,
    sent: &mut SentLog,
    budget: &mut EventBudget,
    faults: &mut Faults,
) -> AppResult<()> {
    let files = std::mem::take(&mut sent.structures);
    let first_code = sent.codes.first().map(|code| code.turn);
    // What stands after the file of the turn before.
    let mut standing: Option<(usize, Structure)> = None;
    for file in files {
        let turn = file.turn;
        let opened = if first_code.is_some_and(|code| code < turn) {
            let detail = "a turn of action code precedes this file; send what each turn left as a file, or none";
            Err(Fault::of(detail.to_owned()))
        } else if !budget.take_file() {
            Err(Fault::of(format!(
                "more than {} structure files in the body; send it in parts",
                LIMITS.structures_in_body
            )))
        } else {
            let slot = app.file_slots.take(who).await;
            let log = std::mem::take(&mut sent.log);
            let before = standing.take().filter(|(of, _)| of + 1 == turn).map(|(_, structure)| structure);
            let (log, opened) = tokio::task::spawn_blocking(move || {
                // Held until the work ends, also if the sender no longer waits.
                let _slot = slot;
                let mut log = log;
                let opened = open_file(&mut log, &file, before);
                (log, opened)
            })
            .await
            .map_err(|error| AppError::internal(&error))?;
            sent.log = log;
            opened
        };
        let opened = opened.and_then(|structure| {
            let events = sent.log.turns[turn].len();
            let is_within = budget.take_events(events);
            let detail = || {
                format!("the files of this body hold more than {} events; send it in parts", LIMITS.action_body_events)
            };
            if is_within { Ok(structure) } else { Err(Fault::of(detail())) }
        });
        match opened {
            Ok(structure) => standing = Some((turn, structure)),
            Err(fault) => {
                faults.enter_key("turns");
                faults.enter_index(turn);
                faults.add_at(fault.member, fault.detail);
                faults.leave();
                faults.leave();
                break;
            }
        }
    }
    Ok(())
}

/// What is wrong with a member of a turn.
struct Fault {
    member: &'static str,
    detail: String,
}

impl Fault {
    fn of(detail: String) -> Self {
        Self { member: "structure", detail }
    }
}

/// Adds the events by which what stood before a file's turn becomes what the file holds, and returns the latter.
fn open_file(log: &mut BlockLog, file: &TurnStructure, before: Option<Structure>) -> Result<Structure, Fault> {
    let after = structure_of(&file.base64, file.corner, log.profile)?;
    let stood = || file.turn.checked_sub(1).and_then(|last| Replay::new(log).nth(last));
    let before = before.or_else(stood).unwrap_or_else(|| Structure::from_named([]));
    let palette = &mut log.palette;
    let events = events_between(&before, &after, |name| palette.intern(name));
    log.turns[file.turn] = events;
    if log.event_count() > LIMITS.events {
        return Err(Fault::of(format!("more than {} events in the log", LIMITS.events)));
    }
    if log.palette.len() > LIMITS.materials {
        return Err(Fault::of(format!("more than {} different materials in the log", LIMITS.materials)));
    }
    Ok(after)
}

/// Reads a file in base64 as a structure of materials, which have no states.
///
/// A bed has two halves in the game. Under `published`, where a bed is one block, its head is left out; otherwise it comes
/// right after the foot, which shows that they belong together.
fn structure_of(base64: &str, corner: Option<[i32; 3]>, profile: Profile) -> Result<Structure, Fault> {
    // Tools wrap base64 at 76 characters.
    let packed: String = base64.split_ascii_whitespace().collect();
    let bytes = STANDARD.decode(packed).map_err(|error| Fault::of(format!("not base64: {error}")))?;
    let (_, build) = formats::read(&bytes, LIMITS.blocks).map_err(|error| Fault::of(error.to_string()))?;
    let shift = match corner {
        None => [0i64; 3],
        Some(corner) => std::array::from_fn(|axis| i64::from(corner[axis]) - i64::from(build.corner[axis])),
    };
    let materials: Vec<&str> = build.palette.iter().map(|block| block.split('[').next().unwrap_or_default()).collect();
    if let Some(long) = materials.iter().find(|name| name.len() > LIMITS.material_chars) {
        let most = LIMITS.material_chars;
        return Err(Fault::of(format!("a name of {} bytes; at most {most} are allowed", long.len())));
    }
    let (heads, listed) = heads_of_beds(&build);
    let blocks = build.blocks.iter().filter(|(at, _)| !listed.contains(at)).flat_map(|block| {
        let head = heads.get(&block.0).filter(|_| !profile.is_published());
        std::iter::once(block).chain(head.map(|head| &build.blocks[*head]))
    });
    let mut entries = Vec::with_capacity(build.blocks.len());
    for (at, material) in blocks {
        let moved: [i64; 3] = std::array::from_fn(|axis| i64::from(at[axis]) + shift[axis]);
        let cell = cell_within(moved).ok_or_else(|| {
            let [x, y, z] = moved;
            let (side, low, high) = (cell::MAX_HORIZONTAL, cell::MIN_Y, cell::MAX_Y);
            Fault {
                member: if corner.is_some() { "corner" } else { "structure" },
                detail: format!(
                    "a block at ({x}, {y}, {z}); x and z are -{side} to {side}, and y is {low} to {high}; \"corner\" moves the build"
                ),
            }
        })?;
        entries.push((cell, materials[*material as usize]));
    }
    Ok(Structure::from_named(entries))
}

/// Finds the beds of which a file has both halves. Returns the index of the head for the position of each foot, and the
/// positions of these heads.
fn heads_of_beds(build: &Build) -> (HashMap<[i32; 3], usize>, HashSet<[i32; 3]>) {
    let beds: Vec<Option<(&str, &str, Side)>> = build.palette.iter().map(|block| bed_half(block)).collect();
    let feet: HashMap<[i32; 3], u32> = build
        .blocks
        .iter()
        .filter(|(_, id)| beds[*id as usize].is_some_and(|(_, part, _)| part == "foot"))
        .copied()
        .collect();
    let (mut heads, mut listed) = (HashMap::new(), HashSet::new());
    for (index, (at, id)) in build.blocks.iter().enumerate() {
        let Some((name, "head", facing)) = beds[*id as usize] else { continue };
        let ahead: [i32; 3] = facing.beside(Cell::new(0, 0, 0)).into();
        let foot: [i32; 3] = std::array::from_fn(|axis| at[axis].wrapping_sub(ahead[axis]));
        let is_foot = |id: &u32| beds[*id as usize] == Some((name, "foot", facing));
        if feet.get(&foot).is_some_and(is_foot) {
            heads.insert(foot, index);
            listed.insert(*at);
        }
    }
    (heads, listed)
}

/// Returns the name, the part and the direction of half a bed.
fn bed_half(block: &str) -> Option<(&'static str, &'static str, Side)> {
    let state = Look::read(block).ok().filter(|look| is_bed(look.state.block().name))?.state;
    Some((state.block().name, state.get("part")?, Side::named(state.get("facing")?)?))
}

fn cell_within([x, y, z]: [i64; 3]) -> Option<Cell> {
    let side = i64::from(-cell::MAX_HORIZONTAL)..=i64::from(cell::MAX_HORIZONTAL);
    let height = i64::from(cell::MIN_Y)..=i64::from(cell::MAX_Y);
    let is_within = side.contains(&x) && side.contains(&z) && height.contains(&y);
    is_within.then(|| Cell::new(x as i32, y as i32, z as i32))
}

/// Returns whether a task checks the order in which blocks are placed.
#[must_use]
pub fn checks_order(task: &Task) -> bool {
    task.checks().any(|check| check.criterion().dimension() == Dimension::Planning)
}

/// Returns what stands after a turn of a stored log as a structure file, and the position of its least corner.
///
/// # Errors
/// Returns 404 if the log has no such turn, and 409 if the format cannot hold the build.
pub fn written(log: &BlockLog, turn: Option<usize>, format: FileFormat) -> AppResult<([i32; 3], Vec<u8>)> {
    let turns = log.turns.len();
    let turn = turn.unwrap_or(turns);
    let structure = turn
        .checked_sub(1)
        .and_then(|index| Replay::new(log).nth(index))
        .ok_or_else(|| AppError::not_found(format!("the log has no turn {turn}; it has {}", counted(turns, "turn"))))?;
    let build = build_of(&structure, log.profile);
    let file = formats::write(format, &build);
    let file = file.map_err(|error| AppError::conflict("structure-too-wide", error.to_string()))?;
    Ok((build.corner, file))
}

/// Returns the blocks of a structure. Logs name materials, not halves: of equal doors on one another the upper one is
/// an upper half. Under `mindcraft`, of equal beds side by side, listed one after the other, the second one is the
/// head; under `published` every bed block is a bed (`docs/rules.md#replay`).
fn build_of(structure: &Structure, profile: Profile) -> Build {
    let material = |i: usize| structure.material(i).strip_prefix("minecraft:").unwrap_or(structure.material(i));
    let listed: Vec<(Cell, &str)> = (0..structure.len()).map(|i| (structure.cells()[i], material(i))).collect();
    let upper = upper_halves(&listed);
    let beds = if profile.is_published() { CellMap::default() } else { bed_halves(&listed) };
    let is_block = |(_, name): &(Cell, &str)| !matches!(*name, "air" | "cave_air" | "void_air");
    Build::of(listed.into_iter().filter(is_block).map(|(cell, name)| {
        let bed = beds.get(&cell).map(String::as_str);
        let state = bed.unwrap_or(if upper.contains(&cell) { "[half=upper]" } else { "" });
        (cell.into(), format!("{name}{state}"))
    }))
}

/// Returns the cells of the upper halves of doors.
fn upper_halves(listed: &[(Cell, &str)]) -> CellSet {
    let mut doors: Vec<(Cell, &str)> = listed.iter().copied().filter(|(_, name)| name.ends_with("_door")).collect();
    // Column by column, from below: of equal doors on one another every other one is an upper half.
    doors.sort_unstable_by_key(|(cell, _)| (cell.x, cell.z, cell.y));
    let mut upper = CellSet::default();
    for pair in doors.windows(2) {
        let [(below, name), (cell, same)] = pair else { continue };
        let is_on = (below.x, below.y + 1, below.z) == (cell.x, cell.y, cell.z);
        if is_on && name == same && !upper.contains(below) {
            upper.insert(*cell);
        }
    }
    upper
}

/// Returns the states of both halves of beds.
fn bed_halves(listed: &[(Cell, &str)]) -> CellMap<String> {
    let mut halves: CellMap<String> = CellMap::default();
    for pair in listed.windows(2) {
        let [(foot, name), (head, same)] = pair else { continue };
        let facing = match (head.x - foot.x, head.y - foot.y, head.z - foot.z) {
            (0, 0, -1) => "north",
            (0, 0, 1) => "south",
            (-1, 0, 0) => "west",
            (1, 0, 0) => "east",
            _ => continue,
        };
        if name.ends_with("_bed") && name == same && !halves.contains_key(foot) {
            halves.insert(*foot, format!("[facing={facing},part=foot]"));
            halves.insert(*head, format!("[facing={facing},part=head]"));
        }
    }
    halves
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(blocks: &[([i32; 3], &str)], profile: Profile) -> Vec<Cell> {
        let build = Build::of(blocks.iter().map(|(at, block)| (*at, (*block).to_owned())));
        let file = STANDARD.encode(formats::write(FileFormat::Nbt, &build).unwrap());
        structure_of(&file, None, profile).map_err(|fault| fault.detail).unwrap().cells().to_vec()
    }

    #[test]
    fn a_bed_in_a_file_is_one_bed() {
        let (foot, head) = ("red_bed[facing=east,part=foot]", "red_bed[facing=east,part=head]");
        let beds = [([0, 0, 1], foot), ([1, 0, 1], head), ([1, 0, 0], foot), ([2, 0, 0], head), ([9, 0, 9], head)];
        let cells = |list: &[(i32, i32)]| list.iter().map(|(x, z)| Cell::new(*x, 0, *z)).collect::<Vec<_>>();
        assert_eq!(sent(&beds, Profile::Published), cells(&[(0, 1), (1, 0), (9, 9)]));
        // The head follows the foot, which tells the beds apart.
        assert_eq!(sent(&beds, Profile::Mindcraft), cells(&[(0, 1), (1, 1), (1, 0), (2, 0), (9, 9)]));
    }

    #[test]
    fn halves_of_doors_and_beds_are_told_apart() {
        let structure = Structure::from_named([
            (Cell::new(0, 0, 0), "oak_door"),
            (Cell::new(0, 1, 0), "oak_door"),
            (Cell::new(3, 0, 3), "red_bed"),
            (Cell::new(3, 0, 2), "red_bed"),
            (Cell::new(3, 0, 1), "red_bed"),
            (Cell::new(9, 0, 9), "red_bed"),
        ]);
        let build = build_of(&structure, Profile::Mindcraft);
        let state = |cell: [i32; 3]| {
            let at = build.blocks.iter().find(|(own, _)| *own == cell);
            at.map(|(_, index)| build.palette[*index as usize].as_str()).unwrap_or_default()
        };
        assert!(state([0, 1, 0]).contains("half=upper") && !state([0, 0, 0]).contains("half=upper"));
        let is_half =
            |cell, part: &str| state(cell).contains(&format!("part={part}")) && state(cell).contains("facing=north");
        assert!(is_half([3, 0, 3], "foot") && is_half([3, 0, 2], "head"), "{build:?}");
        assert!(build_of(&structure, Profile::Published).palette.iter().all(|state| !state.contains("part=")));
        // A bed alone, and one whose partner has another already, stay as they are named.
        assert!([[3, 0, 1], [9, 0, 9]].iter().all(|cell| !state(*cell).contains("part=head")), "{build:?}");
    }
}
