//! Order in which the server copies blocks, which follows from their shapes and their data.

use super::registry::Look;
use super::tags;

/// Blocks with data of their own (block entities), by patterns as those of [`tags`].
const WITH_DATA: &[&str] = &[
    "*chest",
    "*shulker_box",
    "furnace",
    "blast_furnace",
    "smoker",
    "dispenser",
    "dropper",
    "hopper",
    "barrel",
    "*_sign",
    "*_banner",
    "*_bed",
    "*_head",
    "*_skull",
    "!piston_head",
    "brewing_stand",
    "enchanting_table",
    "end_portal",
    "end_gateway",
    "beacon",
    "bell",
    "*campfire",
    "lectern",
    "jukebox",
    "*spawner",
    "vault",
    "creaking_heart",
    "beehive",
    "bee_nest",
    "conduit",
    "daylight_detector",
    "comparator",
    "*sculk_sensor",
    "sculk_catalyst",
    "sculk_shrieker",
    "chiseled_bookshelf",
    "decorated_pot",
    "crafter",
    "*command_block",
    "structure_block",
    "jigsaw",
    "suspicious_*",
    "moving_piston",
];

/// Blocks that the table of the game calls solid and opaque, and that do not fill their cell.
const PARTIAL: &[&str] = &[
    "*_slab",
    "*_stairs",
    "*_fence",
    "*_fence_gate",
    "*_wall",
    "*_door",
    "*_trapdoor",
    "*_pane",
    "*_carpet",
    "*anvil",
    "*candle_cake",
    "*cauldron",
    "iron_bars",
    "chain",
    "cake",
    "cactus",
    "repeater",
    "farmland",
    "dirt_path",
    "end_portal_frame",
    "grindstone",
    "stonecutter",
    "composter",
    "piston_head",
    "big_dripleaf",
    "heavy_core",
    "honey_block",
    "snow",
];

/// Returns when `/clone` sets a block: full cubes first, then blocks with data of their own, then the rest.
pub fn order_of_copy(look: Look) -> u8 {
    let name = look.state.block().name;
    if tags::has(WITH_DATA, name) {
        1
    } else if is_full_cube(look) {
        0
    } else {
        2
    }
}

/// Returns whether a block fills its cell.
fn is_full_cube(look: Look) -> bool {
    let block = look.state.block();
    let fills = |property: &str, value: &str| look.state.get(property) == Some(value);
    if tags::has(PARTIAL, block.name) && !fills("type", "double") && !fills("layers", "8") {
        return false;
    }
    let is_clear =
        ["glass", "_leaves", "ice"].iter().any(|part| block.name.contains(part)) && !block.name.ends_with("_pane");
    block.is_solid() && (!block.is_transparent() || is_clear)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_copied_by_shape_and_data() {
        for (order, blocks) in [
            (0, &["stone", "oak_log", "oak_slab[type=double]", "glass", "oak_leaves", "glowstone"][..]),
            (1, &["chest", "oak_sign", "red_bed", "furnace", "white_banner", "skeleton_skull"]),
            (2, &["oak_slab", "oak_stairs", "oak_fence", "stone_brick_wall", "oak_door", "torch", "air", "glass_pane"]),
        ] {
            for block in blocks {
                assert_eq!(order_of_copy(Look::read(block).unwrap()), order, "{block}");
            }
        }
    }
}
