//! The world: flat ground, the blocks that stand on it, and the record of every change.

use std::collections::BTreeMap;

use super::coordinates::{MAX_Y, MIN_Y, Place};
use super::falling::{self, Fall};
use super::registry::{Block, Look, StateId};
use super::side::Side;
use super::support::{Blocks, breaks_after, turns_into};
use crate::voxel::cell::{Cell, CellMap, MAX_HORIZONTAL};

/// Height of the uppermost layer of natural ground.
pub const GROUND_Y: i32 = -1;
/// Number of blocks that `/fill` and `/clone` may change unless a game rule says otherwise.
pub const BLOCK_LIMIT: i32 = 32_768;
/// Length of a tick of the game.
const TICK_MS: u64 = 50;
/// Greatest number of blocks that `/fill` and `/clone` may visit, whatever the game rule says.
pub const MAX_VOLUME: i64 = 1_000_000;

/// A change of one cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Change {
    /// Cell that changed.
    pub cell: Cell,
    /// Block that now stands there; none if the cell became air.
    pub look: Option<Look>,
}

/// A flat world with cheats on: grass at [`GROUND_Y`], dirt below it, air above, and what was built.
#[derive(Debug, Default)]
pub struct World {
    /// Cells that differ from the natural ground and air, or did so once.
    cells: CellMap<Look>,
    changes: Vec<Change>,
    /// Number of changes after which the world takes no more; `None` for no limit.
    max_changes: Option<usize>,
    is_full: bool,
    /// Number of blocks that `/fill` and `/clone` may change, if a game rule set it.
    pub block_limit: Option<i32>,
    /// Virtual time in milliseconds.
    now_ms: u64,
    /// Cells of blocks that may fall or turn into others, by the time at which they do.
    due: BTreeMap<u64, Vec<Cell>>,
    /// Where the body is.
    pub body: Place,
}

impl Blocks for World {
    fn state(&self, cell: Cell) -> StateId {
        self.look(cell).state
    }
}

/// Returns what nature put into a cell: grass, dirt below it, and air above.
#[must_use]
pub fn natural(cell: Cell) -> Look {
    static GROUND: std::sync::LazyLock<[Look; 2]> = std::sync::LazyLock::new(|| {
        ["grass_block", "dirt"].map(|name| Look::of(Block::named(name).expect("the game has the block")))
    });
    match cell.y {
        GROUND_Y => GROUND[0],
        y if (MIN_Y..GROUND_Y).contains(&y) => GROUND[1],
        _ => Look::AIR,
    }
}

/// Returns whether blocks can stand in a cell.
#[must_use]
pub fn is_in_world(cell: Cell) -> bool {
    let is_near = |value: i32| (-MAX_HORIZONTAL..MAX_HORIZONTAL).contains(&value);
    is_near(cell.x) && is_near(cell.z) && (MIN_Y..=MAX_Y).contains(&cell.y)
}

impl World {
    /// Creates a world that stops changing after `max_changes` changes.
    #[must_use]
    pub fn with_limit(max_changes: usize) -> Self {
        Self { max_changes: Some(max_changes), ..Self::default() }
    }

    /// Returns the block in a cell.
    #[must_use]
    pub fn look(&self, cell: Cell) -> Look {
        self.cells.get(&cell).copied().unwrap_or_else(|| natural(cell))
    }

    /// Returns the state of a cell.
    #[must_use]
    pub fn state(&self, cell: Cell) -> StateId {
        self.look(cell).state
    }

    /// Returns all changes so far, in order.
    #[must_use]
    pub fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Returns whether the world stopped changing at its limit.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.is_full
    }

    /// Returns the virtual time, in milliseconds.
    #[must_use]
    pub fn now_ms(&self) -> u64 {
        self.now_ms
    }

    /// Returns the cells that differ from the natural world, with what stands there.
    pub fn built(&self) -> impl Iterator<Item = (Cell, Look)> {
        self.cells.iter().filter(|(cell, look)| **look != natural(**cell)).map(|(cell, look)| (*cell, *look))
    }

    /// Puts a block where it stood, as it stood. This is no change and updates nothing.
    pub fn put(&mut self, cell: Cell, look: Look) {
        self.cells.insert(cell, look);
    }

    /// Puts a block where an earlier turn left it. This is no change and updates nothing. A door upon the lower half of
    /// an equal one becomes its upper half, because events name no states.
    pub fn restore(&mut self, cell: Cell, look: Look) {
        let below = self.state(cell.offset(0, -1, 0));
        let is_upper = look.state.block().name.ends_with("_door")
            && below.block().number == look.state.block().number
            && below.get("half") == Some("lower");
        self.cells.insert(cell, if is_upper { look.with("half", "upper") } else { look });
    }

    /// Returns about how much memory the world takes, in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let due: usize = self.due.values().map(Vec::capacity).sum();
        self.cells.capacity() * (size_of::<(Cell, Look)>() + 1)
            + self.changes.capacity() * size_of::<Change>()
            + due * size_of::<Cell>()
    }

    /// Sets the virtual time at which the world begins.
    pub fn start_at(&mut self, now_ms: u64) {
        self.now_ms = now_ms;
    }

    /// Places a block as a command does: it takes over what its other half says. Returns whether the cell changed.
    pub(super) fn place(&mut self, cell: Cell, look: Look) -> bool {
        self.set(cell, self.beside_its_half(cell, look))
    }

    /// Returns a door's half as the half that stands there makes it: of the same door, with its direction, hinge and so
    /// on, unless the command named them.
    fn beside_its_half(&self, cell: Cell, look: Look) -> Look {
        let is_door = |state: StateId| state.block().name.ends_with("_door");
        let Some(half) = look.state.get("half").filter(|_| is_door(look.state)) else { return look };
        let other = self.state(cell.offset(0, if half == "upper" { -1 } else { 1 }, 0));
        if !is_door(other) || other.get("half") == Some(half) {
            return look;
        }
        let (block, wanted) = (other.block(), look.state.block());
        let mut taken = Look { state: other, named: 0 };
        for (at, property) in wanted.properties.iter().enumerate() {
            let is_named = look.named & 1 << at != 0;
            if is_named || property.name == "half" {
                let value = look.state.get(property.name).expect("a property of its own block");
                taken.state = block.with(taken.state, property.name, value).unwrap_or(taken.state);
            }
            taken.named |= look.named & 1 << at;
        }
        taken
    }

    /// Makes the other half of a door like the half in a cell. This is no change of its own.
    fn match_halves(&mut self, cell: Cell) {
        let state = self.state(cell);
        let Some(half) = state.get("half").filter(|_| state.block().name.ends_with("_door")) else { return };
        let (there, half) =
            if half == "upper" { (cell.offset(0, -1, 0), "lower") } else { (cell.offset(0, 1, 0), "upper") };
        let other = self.look(there);
        if other.state.block().number == state.block().number && other.state.get("half") == Some(half) {
            let like = state.block().with(state, "half", half).expect("a door has halves");
            self.cells.insert(there, Look { state: like, named: other.named });
        }
    }

    /// Sets a cell, records the change, and updates what is around it. Returns whether the state changed.
    pub fn set(&mut self, cell: Cell, look: Look) -> bool {
        if self.is_full || !self.set_alone(cell, look) {
            return false;
        }
        self.match_halves(cell);
        // What follows from an update comes before the next side, as on the server.
        let mut changed = vec![(cell, 0)];
        while let Some((cell, side_number)) = changed.last_mut() {
            let cell = *cell;
            let Some(side) = Side::IN_ORDER_OF_UPDATES.get(*side_number) else {
                changed.pop();
                continue;
            };
            if *side_number == 0 {
                self.watch(cell);
            }
            *side_number += 1;
            let neighbour = side.beside(cell);
            self.watch(neighbour);
            if breaks_after(self, neighbour, side.opposite()) && self.set_alone(neighbour, Look::AIR) {
                changed.push((neighbour, 0));
            }
        }
        true
    }

    /// Sets a cell and records the change, without any update.
    fn set_alone(&mut self, cell: Cell, look: Look) -> bool {
        let old = self.look(cell);
        if old.state == look.state || self.is_full || !is_in_world(cell) {
            return false;
        }
        if self.max_changes.is_some_and(|most| self.changes.len() >= most) {
            self.is_full = true;
            return false;
        }
        self.cells.insert(cell, look);
        let is_air = look.state.is_air();
        if !(is_air && old.state.is_air()) {
            self.changes.push(Change { cell, look: (!is_air).then_some(look) });
        }
        true
    }

    /// Notes that the block in a cell may fall or turn into another one soon.
    fn watch(&mut self, cell: Cell) {
        let name = self.state(cell).block().name;
        let delay = if falling::falls(name) {
            falling::DELAY_MS
        } else if turns_into(self, cell).is_some() {
            TICK_MS
        } else {
            return;
        };
        let due = self.due.entry(self.now_ms + delay).or_default();
        if due.last() != Some(&cell) {
            due.push(cell);
        }
    }

    /// Lets time pass until `to_ms`, in which blocks without support fall.
    pub fn pass_time(&mut self, to_ms: u64) {
        while let Some(due) = self.due.first_entry().filter(|entry| *entry.key() <= to_ms) {
            let (at, cells) = due.remove_entry();
            self.now_ms = self.now_ms.max(at);
            for cell in cells {
                match turns_into(self, cell).map(|name| Block::named(name).expect("the game has the block")) {
                    Some(block) => drop(self.set(cell, Look::of(block))),
                    None => self.fall(cell),
                }
            }
        }
        self.now_ms = self.now_ms.max(to_ms);
    }

    /// Lets the block in a cell fall, if nothing holds it.
    fn fall(&mut self, cell: Cell) {
        let look = self.look(cell);
        let Some(fall) = falling::fall(self, cell) else { return };
        self.set(cell, Look::AIR);
        let Fall::Lands(end) = fall else { return };
        let hardened = look.state.block().name.strip_suffix("_powder").and_then(Block::named);
        let look = hardened.filter(|_| self.state(end).block().name == "water").map_or(look, Look::of);
        self.set(end, look);
    }

    /// Lets every block fall that nothing holds.
    pub fn settle(&mut self) {
        while let Some(last) = self.due.last_key_value().map(|(at, _)| *at) {
            self.pass_time(last);
        }
    }

    /// Returns the number of blocks that a command may visit.
    pub(super) fn volume_limit(&self) -> i64 {
        i64::from(self.block_limit.unwrap_or(BLOCK_LIMIT)).min(MAX_VOLUME)
    }
}
