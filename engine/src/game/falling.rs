//! Blocks that fall, such as sand.

use super::coordinates::MIN_Y;
use super::registry::Look;
use super::world::World;
use crate::voxel::cell::Cell;

/// Time between the moment at which a block loses its support and its fall: two ticks of the game.
pub const DELAY_MS: u64 = 100;

/// Returns whether blocks of this name fall if nothing holds them.
pub fn falls(name: &str) -> bool {
    matches!(
        name,
        "sand"
            | "red_sand"
            | "suspicious_sand"
            | "gravel"
            | "suspicious_gravel"
            | "anvil"
            | "chipped_anvil"
            | "damaged_anvil"
            | "dragon_egg"
    ) || name.ends_with("_concrete_powder")
}

/// Returns whether a falling block passes through a block, or takes its place.
fn is_free(look: Look) -> bool {
    look.state.is_air()
        || matches!(
            look.state.block().name,
            "water"
                | "lava"
                | "fire"
                | "soul_fire"
                | "short_grass"
                | "fern"
                | "dead_bush"
                | "tall_grass"
                | "large_fern"
                | "vine"
                | "seagrass"
                | "tall_seagrass"
                | "glow_lichen"
                | "hanging_roots"
                | "bubble_column"
                | "structure_void"
                | "light"
                | "warped_roots"
                | "crimson_roots"
                | "nether_sprouts"
        )
        || (look.state.block().name == "snow" && look.state.get("layers") == Some("1"))
}

/// Lets the block in a cell fall to where something holds it, at once: the time of the fall itself is not simulated. It is
/// lost if it falls out of the world.
pub fn fall(world: &mut World, cell: Cell) {
    let look = world.look(cell);
    if !falls(look.state.block().name) || !is_free(world.look(cell.offset(0, -1, 0))) {
        return;
    }
    let mut end = cell.offset(0, -1, 0);
    while end.y >= MIN_Y && is_free(world.look(end.offset(0, -1, 0))) {
        end = end.offset(0, -1, 0);
    }
    world.set(cell, Look::AIR);
    if end.y >= MIN_Y {
        world.set(end, look);
    }
}
