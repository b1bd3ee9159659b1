//! Commands carried out in a world, as a vanilla server does.

use super::command::{Command, SetMode, Step, View};
use super::coordinates::Place;
use super::refusal::Refusal;
use super::region;
use super::registry::Look;
use super::world::World;
use crate::voxel::cell::Cell;

/// Height of the eyes of the body above its feet, in blocks.
const EYES: f64 = 1.62;

impl World {
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
            Command::Teleport { to, view } => {
                let position = to.position(at);
                let is_inside = position[0].abs() <= 3e7 && position[2].abs() <= 3e7 && position[1].abs() <= 2e7;
                if !is_inside {
                    return Err(Refusal::new("invalid position for teleport"));
                }
                self.body.position = position;
                let [yaw, pitch] = match view {
                    None => [self.body.yaw, self.body.pitch],
                    Some(View::Angles([yaw, pitch])) => [yaw.from(at.yaw), pitch.from(at.pitch)],
                    Some(View::Facing(target)) => Place { anchor: at.anchor, ..self.body }.towards(target.position(at)),
                };
                (self.body.yaw, self.body.pitch) = (yaw, pitch.clamp(-90.0, 90.0));
                Ok(0)
            }
            Command::BlockLimit { blocks } => {
                self.block_limit = Some(*blocks);
                Ok(0)
            }
            Command::From { steps, run } => {
                let place = steps.iter().fold(*at, |place, step| self.after(place, *step));
                self.carry_out(run, &place)
            }
            Command::Harmless => Ok(0),
        }
    }

    fn after(&self, place: Place, step: Step) -> Place {
        match step {
            Step::AtBody => Place { anchor: place.anchor, ..self.body },
            Step::PositionedAsBody => Place { position: self.body.position, ..place },
            Step::RotatedAsBody => Place { yaw: self.body.yaw, pitch: self.body.pitch, ..place },
            Step::Positioned(position) => Place { position: position.position(&place), anchor: 0.0, ..place },
            Step::Rotated([yaw, pitch]) => Place { yaw: yaw.from(place.yaw), pitch: pitch.from(place.pitch), ..place },
            Step::Anchored { at_eyes } => Place { anchor: if at_eyes { EYES } else { 0.0 }, ..place },
            Step::Aligned(axes) => {
                let aligned =
                    |axis: usize| if axes[axis] { place.position[axis].floor() } else { place.position[axis] };
                Place { position: std::array::from_fn(aligned), ..place }
            }
        }
    }

    fn set_by_command(&mut self, cell: Cell, look: Look, mode: SetMode) -> Result<(), Refusal> {
        let refused = || Refusal::new("could not set the block: it is there already");
        match mode {
            SetMode::Keep if !self.look(cell).state.is_air() => {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::game::world::Change;
    use crate::voxel::cell::Cell;

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
    fn a_body_turns_and_commands_count_from_it() {
        for (commands, at) in [
            (["tp @s 0 0 0 facing 10 0 0.5", "setblock ^ ^ ^2 stone"], "stone@2,0,0"),
            (["tp @s 0 0 0 facing 0.5 9 0.5", "setblock ^ ^ ^2 stone"], "stone@0,2,0"),
            (["tp @s ~ ~ ~ ~90 ~", "setblock ^ ^ ^2 stone"], "stone@-2,0,0"),
            (["execute rotated 90 0 run tp @s ~ ~ ~ ~ ~", "setblock ^ ^ ^5 stone"], "stone@-5,0,0"),
            (["execute anchored eyes run tp @s ~ ~ ~ facing ^ ^ ^5", "setblock ^ ^ ^9 stone"], "stone@0,0,9"),
            (["tp @s ~ ~ ~ ~ 100", "setblock ^ ^ ^9 stone"], "stone@0,-9,0"),
            (["tp @s 5 0 5", "execute positioned as @s rotated as @s run setblock ^ ^ ^1 stone"], "stone@5,0,6"),
            (["tp @s 0 0 0", "execute anchored eyes run setblock ^ ^ ^3 stone"], "stone@0,1,3"),
            (["tp @s 0 0 0", "execute anchored eyes positioned 0 0 0 run setblock ^ ^ ^3 stone"], "stone@0,0,3"),
            (["tp @s 0 0 0", "execute rotated ~90 ~ run setblock ^ ^ ^1 stone"], "stone@-1,0,0"),
        ] {
            assert_eq!(told(&after(&commands)), [at], "{commands:?}");
        }
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
