//! Blocks that fall, such as sand.

use super::coordinates::MIN_Y;
use super::registry::StateId;
use super::support::Blocks;
use super::tags;
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
fn is_free(state: StateId) -> bool {
    let patterns = tags::patterns_of("replaceable").expect("the tag is known");
    tags::has(patterns, state.block().name) && state.get("layers").is_none_or(|layers| layers == "1")
}

/// What becomes of a block that falls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fall {
    /// It comes to rest in a cell.
    Lands(Cell),
    /// It falls out of the world, or onto something on which it breaks.
    Breaks,
}

/// Returns what becomes of the block in a cell: none if it stays. The time of the fall itself is not simulated.
pub fn fall(blocks: &impl Blocks, cell: Cell) -> Option<Fall> {
    let below = |cell: Cell| cell.offset(0, -1, 0);
    if !falls(blocks.state(cell).block().name) || !is_free(blocks.state(below(cell))) {
        return None;
    }
    let mut end = below(cell);
    // Once it moves, it passes through everything without a collision box.
    while end.y >= MIN_Y && !blocks.state(below(end)).block().is_solid() {
        end = below(end);
    }
    let has_place = end.y >= MIN_Y && is_free(blocks.state(end)) && !is_low(blocks.state(below(end)));
    Some(if has_place { Fall::Lands(end) } else { Fall::Breaks })
}

/// Returns whether a block is lower than its cell, so that what falls onto it ends within the cell and breaks.
fn is_low(state: StateId) -> bool {
    let name = state.block().name;
    let is_low_half = name.ends_with("_slab") && state.get("type") == Some("bottom");
    is_low_half
        || name.ends_with("_bed")
        || name.ends_with("_carpet")
        || name.ends_with("chest")
        || matches!(
            name,
            "farmland"
                | "dirt_path"
                | "soul_sand"
                | "mud"
                | "snow"
                | "cake"
                | "enchanting_table"
                | "daylight_detector"
                | "stonecutter"
                | "campfire"
                | "soul_campfire"
                | "lily_pad"
        )
}
