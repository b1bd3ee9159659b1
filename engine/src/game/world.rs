//! The world: flat ground, the blocks that stand on it, and the record of every change.

use std::collections::BTreeMap;

use super::command::{Command, Refusal, SetMode};
use super::coordinates::{MAX_Y, MIN_Y, Place};
use super::registry::{Block, Look, StateId};
use super::support::{Side, breaks_after, turns_into};
use super::{falling, region};
use crate::voxel::cell::{Cell, CellMap};

/// Height of the uppermost layer of natural ground.
pub const GROUND_Y: i32 = -1;
/// Number of blocks that `/fill` and `/clone` may change unless a game rule says otherwise.
pub const BLOCK_LIMIT: i32 = 32_768;
/// Length of a tick of the game.
const TICK_MS: u64 = 50;
/// Greatest number of blocks that `/fill` and `/clone` may visit, whatever the game rule says.
const MAX_VOLUME: i64 = 1_000_000;

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
    block_limit: Option<i32>,
    /// Virtual time in milliseconds.
    now_ms: u64,
    /// Cells of blocks that may fall or turn into others, by the time at which they do.
    due: BTreeMap<u64, Vec<Cell>>,
    /// Where the body is.
    pub body: Place,
}

/// Returns what nature put into a cell.
fn natural(cell: Cell) -> Look {
    static GROUND: std::sync::LazyLock<[Look; 2]> = std::sync::LazyLock::new(|| {
        ["grass_block", "dirt"].map(|name| Look::of(Block::named(name).expect("the game has the block")))
    });
    match cell.y {
        GROUND_Y => GROUND[0],
        y if (MIN_Y..GROUND_Y).contains(&y) => GROUND[1],
        _ => Look::AIR,
    }
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

    /// Puts a block where an earlier turn left it. This is no change and updates nothing.
    pub fn restore(&mut self, cell: Cell, look: Look) {
        self.cells.insert(cell, look);
    }

    /// Sets the virtual time at which the world begins.
    pub fn start_at(&mut self, now_ms: u64) {
        self.now_ms = now_ms;
    }

    /// Carries out a command given without its slash, and returns the number of blocks that it changed.
    ///
    /// # Errors
    /// Returns why a vanilla server refuses the command.
    pub fn command(&mut self, text: &str) -> Result<usize, Refusal> {
        let command = Command::read(text)?;
        let at = self.body;
        self.carry_out(&command, &at)
    }

    /// Carries out a command from a place.
    ///
    /// # Errors
    /// Returns why a vanilla server refuses the command.
    pub fn carry_out(&mut self, command: &Command, at: &Place) -> Result<usize, Refusal> {
        match command {
            Command::SetBlock { at: to, look, mode } => self.set_by_command(to.cell(at)?, *look, *mode).map(|()| 1),
            Command::Fill { corners, look, mode } => {
                let [from, to] = [corners[0].cell(at)?, corners[1].cell(at)?];
                region::fill(self, &region::Region::between(from, to), *look, mode)
            }
            Command::Clone { corners, to, which, mode } => {
                let from = region::Region::between(corners[0].cell(at)?, corners[1].cell(at)?);
                region::clone(self, &from, to.cell(at)?, which, *mode)
            }
            Command::Teleport { to } => {
                let position = to.position(at);
                let is_inside = position[0].abs() <= 3e7 && position[2].abs() <= 3e7 && position[1].abs() <= 2e7;
                if !is_inside {
                    return Err(Refusal::new("invalid position for teleport"));
                }
                self.body.position = position;
                Ok(0)
            }
            Command::BlockLimit { blocks } => {
                self.block_limit = Some(*blocks);
                Ok(0)
            }
            Command::At { position, run } => {
                let place = Place { position: position.position(at), ..*at };
                self.carry_out(run, &place)
            }
            Command::Harmless => Ok(0),
        }
    }

    fn set_by_command(&mut self, cell: Cell, look: Look, mode: SetMode) -> Result<(), Refusal> {
        let refused = || Refusal::new("could not set the block: it is there already");
        match mode {
            SetMode::Keep if !self.state(cell).is_air() => {
                return Err(Refusal::new("could not set the block: the cell is not air"));
            }
            SetMode::Destroy => {
                let was_removed = self.set(cell, Look::AIR);
                if look.state.is_air() {
                    return if was_removed { Ok(()) } else { Err(refused()) };
                }
            }
            SetMode::Keep | SetMode::Replace => {}
        }
        if self.place(cell, look) { Ok(()) } else { Err(refused()) }
    }

    /// Places a block as a command does: it takes over what its other half says. Returns whether the cell changed.
    pub(super) fn place(&mut self, cell: Cell, look: Look) -> bool {
        self.set(cell, self.beside_its_half(cell, look))
    }

    /// Returns a door's half as the half that stands there makes it: of the same door, with its direction, hinge and so on,
    /// unless the command named them.
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
        let mut changed = vec![cell];
        while let Some(cell) = changed.pop() {
            self.watch(cell);
            for side in Side::IN_ORDER_OF_UPDATES {
                let neighbour = side.beside(cell);
                if neighbour.y < MIN_Y || neighbour.y > MAX_Y {
                    continue;
                }
                self.watch(neighbour);
                if breaks_after(self, neighbour, side.opposite()) && self.set_alone(neighbour, Look::AIR) {
                    changed.push(neighbour);
                }
            }
        }
        true
    }

    /// Sets a cell and records the change, without any update.
    fn set_alone(&mut self, cell: Cell, look: Look) -> bool {
        let old = self.look(cell);
        if old.state == look.state || self.is_full {
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
        self.due.entry(self.now_ms + delay).or_default().push(cell);
    }

    /// Lets time pass until `to_ms`, in which blocks without support fall.
    pub fn pass_time(&mut self, to_ms: u64) {
        while let Some(due) = self.due.first_entry().filter(|entry| *entry.key() <= to_ms) {
            let (at, cells) = due.remove_entry();
            self.now_ms = self.now_ms.max(at);
            for cell in cells {
                match turns_into(self, cell).map(|name| Block::named(name).expect("the game has the block")) {
                    Some(block) => drop(self.set(cell, Look::of(block))),
                    None => falling::fall(self, cell),
                }
            }
        }
        self.now_ms = self.now_ms.max(to_ms);
    }

    /// Lets everything fall that will.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn after(commands: &[&str]) -> World {
        let mut world = World::default();
        for command in commands {
            world.command(command).unwrap_or_else(|refusal| panic!("{command}: {refusal}"));
        }
        world
    }

    fn told(world: &World) -> Vec<String> {
        let one = |change: &Change| {
            let Change { cell: Cell { x, y, z }, look } = change;
            look.map_or(format!("-{x},{y},{z}"), |look| format!("{look}@{x},{y},{z}"))
        };
        world.changes().iter().map(one).collect()
    }

    #[test]
    fn the_same_state_again_is_refused_and_no_change() {
        let mut world = after(&["setblock 0 0 0 stone"]);
        assert!(world.command("setblock 0 0 0 stone").is_err());
        assert!(world.command("setblock 0 -1 0 grass_block").is_err());
        assert!(world.command("setblock 0 5 0 air").is_err());
        world.command("setblock 0 -1 0 stone").unwrap();
        assert_eq!(told(&world), ["stone@0,0,0", "stone@0,-1,0"]);
        assert_eq!(world.built().count(), 2);
    }

    #[test]
    fn half_a_removed_door_or_bed_takes_the_other_half() {
        let mut world = after(&["setblock 0 0 0 oak_door[facing=east]", "setblock 0 1 0 oak_door[half=upper]"]);
        assert_eq!(world.state(Cell::new(0, 1, 0)).get("facing"), Some("east"));
        assert_eq!(world.look(Cell::new(0, 1, 0)).to_string(), "oak_door[half=upper]");
        world.command("setblock 0 1 0 air").unwrap();
        assert_eq!(told(&world)[2..], ["-0,1,0", "-0,0,0"]);
        let mut world = after(&["setblock 0 0 0 red_bed", "setblock 0 0 -1 red_bed[part=head]"]);
        world.command("setblock 0 0 0 stone").unwrap();
        assert_eq!(told(&world)[2..], ["stone@0,0,0", "-0,0,-1"]);
    }

    #[test]
    fn a_half_placed_onto_another_door_becomes_that_door() {
        let world =
            after(&["setblock 0 0 0 oak_door[facing=south]", "setblock 0 1 0 spruce_door[half=upper,hinge=right]"]);
        assert_eq!(told(&world)[1..], ["oak_door[half=upper,hinge=right]@0,1,0"]);
        assert_eq!(world.state(Cell::new(0, 0, 0)).get("hinge"), Some("right"));
        let world = after(&["fill 0 0 0 0 1 0 oak_door"]);
        assert_eq!((told(&world).len(), world.built().count()), (4, 0));
    }

    #[test]
    fn plants_need_their_ground_as_soon_as_a_neighbour_changes() {
        let world =
            after(&["setblock 0 0 0 poppy", "setblock 5 0 0 stone", "setblock 5 1 0 poppy", "setblock 6 1 0 glass"]);
        assert_eq!(told(&world)[3..], ["glass@6,1,0", "-5,1,0"]);
        let mut world = after(&["setblock 0 0 0 cactus", "setblock 3 -1 0 farmland", "setblock 3 0 0 stone"]);
        world.settle();
        assert_eq!(told(&world)[3..], ["-0,0,0", "dirt@3,-1,0"]);
    }

    #[test]
    fn what_hangs_on_a_block_drops_with_it() {
        let mut world =
            after(&["setblock 0 0 0 stone", "setblock 0 1 0 torch", "setblock 1 0 0 wall_torch[facing=east]"]);
        world.command("setblock 0 0 0 air").unwrap();
        let mut dropped = told(&world)[3..].to_vec();
        dropped.sort();
        assert_eq!(dropped, ["-0,0,0", "-0,1,0", "-1,0,0"]);
    }

    #[test]
    fn sand_falls_when_time_passes() {
        let mut world = after(&["setblock 0 3 0 sand", "setblock 5 3 0 sand", "setblock 5 2 0 stone"]);
        world.pass_time(99);
        assert_eq!(world.changes().len(), 3);
        world.pass_time(100);
        assert_eq!(told(&world)[3..], ["-0,3,0", "sand@0,0,0"]);
        world.command("setblock 5 2 0 air").unwrap();
        world.settle();
        assert_eq!(told(&world)[5..], ["-5,2,0", "-5,3,0", "sand@5,0,0"]);
    }

    #[test]
    fn modes_of_setblock() {
        let mut world = after(&["setblock 0 0 0 stone", "setblock 0 0 0 dirt destroy"]);
        assert_eq!(told(&world), ["stone@0,0,0", "-0,0,0", "dirt@0,0,0"]);
        assert!(world.command("setblock 0 0 0 glass keep").is_err());
        assert!(world.command("setblock 0 1 0 air destroy").is_err());
        world.command("setblock 0 0 0 air destroy").unwrap();
    }

    #[test]
    fn a_world_at_its_limit_takes_no_more_changes() {
        let mut world = World::with_limit(2);
        assert_eq!(world.command("fill 0 0 0 9 0 0 stone").unwrap(), 2);
        assert!(world.is_full());
        assert_eq!(world.changes().len(), 2);
    }
}
