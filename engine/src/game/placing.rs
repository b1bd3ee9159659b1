//! Placing by hand: what a player's click makes of an item, by the clicked face and the direction of view.

use super::registry::{Block, Look};
use super::side::Side;
use super::support::is_held;
use super::tags;
use super::world::{World, is_in_world};
use crate::voxel::cell::Cell;

/// Blocks whose items have other names.
const NAMES: [(&str, &str); 12] = [
    ("redstone", "redstone_wire"),
    ("string", "tripwire"),
    ("wheat_seeds", "wheat"),
    ("carrot", "carrots"),
    ("potato", "potatoes"),
    ("beetroot_seeds", "beetroots"),
    ("melon_seeds", "melon_stem"),
    ("pumpkin_seeds", "pumpkin_stem"),
    ("sweet_berries", "sweet_berry_bush"),
    ("glow_berries", "cave_vines"),
    ("cocoa_beans", "cocoa"),
    ("torchflower_seeds", "torchflower_crop"),
];

impl World {
    /// Places the block of an item against a face of a block.
    ///
    /// # Errors
    /// Returns why nothing was placed.
    pub fn place_by_hand(&mut self, against: Cell, face: Side, item: &str) -> Result<(), String> {
        let name = NAMES.iter().find(|(known, _)| *known == item).map_or(item, |(_, block)| *block);
        let block = Block::named(name).ok_or_else(|| format!("no block has been placed: {item} is no block"))?;
        if let Some(double) = self.doubled_slab(against, face, block) {
            self.set(against, double);
            return Ok(());
        }
        let cell = if is_replaceable(self.look(against)) { against } else { face.beside(against) };
        let there = self.look(cell);
        if !is_in_world(cell) {
            return Err("no block has been placed: the position is out of this world".to_owned());
        }
        if !is_replaceable(there) {
            return Err(format!("no block has been placed: the block is still {}", there.state.block().name));
        }
        let looks = self.body.facing();
        let look = turned(block, face, looks);
        let second = if name.ends_with("_door") {
            Some((cell.offset(0, 1, 0), look.with("half", "upper")))
        } else if name.ends_with("_bed") {
            Some((looks.beside(cell), look.with("part", "head")))
        } else {
            None
        };
        if second.is_some_and(|(other, _)| !is_replaceable(self.look(other))) {
            return Err(format!("no block has been placed: there is no room for the whole {name}"));
        }
        if !is_held(self, cell, look.state) {
            return Err(format!("no block has been placed: {name} has nothing to hold on to there"));
        }
        self.set(cell, look);
        if let Some((other, look)) = second {
            self.set(other, look);
        }
        if cell == against {
            // A bot looks for the block beside the one that it clicked.
            return Err(format!(
                "no block has been placed beside {against:?}: it was replaceable, so {name} took its place"
            ));
        }
        Ok(())
    }

    /// Returns the double slab that a slab makes of an equal one.
    fn doubled_slab(&self, against: Cell, face: Side, block: &'static Block) -> Option<Look> {
        let there = self.look(against);
        let fits = matches!((there.state.get("type"), face), (Some("bottom"), Side::Up) | (Some("top"), Side::Down));
        (block.name.ends_with("_slab") && there.state.block().number == block.number && fits)
            .then(|| there.with("type", "double"))
    }
}

/// Returns the block as it is turned when it is placed. The click is in the middle of the face.
fn turned(block: &'static Block, face: Side, looks: Side) -> Look {
    let name = block.name;
    let plain = Look::of(block);
    let is_side = !matches!(face, Side::Up | Side::Down);
    let half = if face == Side::Down { "top" } else { "bottom" };
    if name.ends_with("_stairs") {
        return plain.with("facing", looks.name()).with("half", half);
    }
    if name.ends_with("_slab") {
        return plain.with("type", half);
    }
    if name.ends_with("_door") || name.ends_with("_bed") || name.ends_with("_fence_gate") || name.ends_with("campfire")
    {
        return plain.with("facing", looks.name());
    }
    if name.ends_with("_trapdoor") {
        let facing = if is_side { face } else { looks.opposite() };
        return plain.with("facing", facing.name()).with("half", half);
    }
    if is_side && let Some(on_wall) = on_wall(name) {
        return Look::of(on_wall).with("facing", face.name());
    }
    if matches!(name, "ladder" | "tripwire_hook") {
        return if is_side { plain.with("facing", face.name()) } else { plain };
    }
    if name.ends_with("_button") || matches!(name, "lever" | "grindstone") {
        return match face {
            Side::Up => plain.with("face", "floor").with("facing", looks.name()),
            Side::Down => plain.with("face", "ceiling").with("facing", looks.name()),
            side => plain.with("face", "wall").with("facing", side.name()),
        };
    }
    if matches!(name, "lantern" | "soul_lantern") && face == Side::Down {
        return plain.with("hanging", "true");
    }
    if matches!(name, "end_rod" | "lightning_rod") || name.ends_with("shulker_box") {
        return plain.with("facing", face.name());
    }
    if name == "hopper" {
        return plain.with("facing", if is_side { face.opposite().name() } else { "down" });
    }
    if name.ends_with("anvil") {
        return plain.with("facing", looks.clockwise().name());
    }
    if name.ends_with("_leaves") {
        return plain.with("persistent", "true");
    }
    if block.property("axis").is_some() {
        let axis = match face {
            Side::Up | Side::Down => "y",
            Side::East | Side::West => "x",
            Side::North | Side::South => "z",
        };
        return plain.with("axis", axis);
    }
    // Furnaces, chests and the like face the player.
    plain.with("facing", looks.opposite().name())
}

/// Returns the block that an item makes on a wall, if that is another one.
fn on_wall(name: &str) -> Option<&'static Block> {
    let other = match name {
        "torch" => "wall_torch".to_owned(),
        "soul_torch" => "soul_wall_torch".to_owned(),
        "redstone_torch" => "redstone_wall_torch".to_owned(),
        _ if name.ends_with("_hanging_sign") => return None,
        _ => name
            .strip_suffix("_sign")
            .map(|wood| format!("{wood}_wall_sign"))
            .or_else(|| name.strip_suffix("_banner").map(|colour| format!("{colour}_wall_banner")))?,
    };
    Block::named(&other)
}

/// Returns whether a placed block takes the place of another one.
fn is_replaceable(look: Look) -> bool {
    let patterns = tags::patterns_of("replaceable").expect("the tag is known");
    tags::has(patterns, look.state.block().name) && look.state.get("layers").is_none_or(|layers| layers == "1")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(yaw: f64, against: &str, face: Side, item: &str) -> Vec<String> {
        let mut world = World::default();
        world.command(&format!("setblock 0 2 0 {against}")).unwrap();
        world.body.yaw = yaw;
        let before = world.changes().len();
        world.place_by_hand(Cell::new(0, 2, 0), face, item).unwrap();
        world.changes()[before..].iter().map(|change| change.look.unwrap().to_string()).collect()
    }

    #[test]
    fn blocks_turn_by_the_face_and_the_view() {
        assert_eq!(placed(0.0, "stone", Side::Up, "oak_stairs"), ["oak_stairs[facing=south,half=bottom]"]);
        assert_eq!(placed(90.0, "stone", Side::Down, "oak_stairs"), ["oak_stairs[facing=west,half=top]"]);
        assert_eq!(placed(0.0, "stone", Side::East, "oak_log"), ["oak_log[axis=x]"]);
        assert_eq!(placed(0.0, "stone", Side::East, "torch"), ["wall_torch[facing=east]"]);
        assert_eq!(placed(0.0, "stone", Side::Up, "torch"), ["torch"]);
        assert_eq!(placed(180.0, "stone", Side::Up, "furnace"), ["furnace[facing=south]"]);
        assert_eq!(placed(0.0, "stone", Side::Up, "stone_button"), ["stone_button[face=floor,facing=south]"]);
        assert_eq!(placed(0.0, "oak_slab", Side::Up, "oak_slab"), ["oak_slab[type=double]"]);
        assert_eq!(
            placed(-90.0, "stone", Side::Up, "oak_door"),
            ["oak_door[facing=east]", "oak_door[facing=east,half=upper]"]
        );
        assert_eq!(
            placed(0.0, "stone", Side::Up, "red_bed"),
            ["red_bed[facing=south]", "red_bed[facing=south,part=head]"]
        );
    }

    #[test]
    fn an_occupied_cell_refuses() {
        let mut world = World::default();
        world.command("fill 0 0 0 0 1 0 stone").unwrap();
        assert!(world.place_by_hand(Cell::new(0, 0, 0), Side::Up, "glass").unwrap_err().contains("still stone"));
        assert!(world.place_by_hand(Cell::new(0, 1, 0), Side::Up, "stick").is_err());
    }
}
