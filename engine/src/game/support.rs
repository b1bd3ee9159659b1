//! Blocks that break when what they need is gone: halves without their other half, and what stands on, hangs from or
//! leans against a block that was removed.
//!
//! The server checks this only when a neighbour changes, so what a command places without support stays until then.

use super::registry::{Block, StateId};
use super::side::Side;
use crate::voxel::cell::Cell;

/// Blocks that can be looked at.
pub trait Blocks {
    /// Returns the state of a cell.
    fn state(&self, cell: Cell) -> StateId;
}

/// What a block needs beside it, and when the server looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Need {
    /// The other half of the same block on a side.
    Half(Side, &'static str),
    /// Something to hold on to, checked when that side changes.
    Hold(Side),
    /// Something of a kind to stand on, checked when any neighbour changes.
    Ground(Ground),
}

/// What a block stands on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ground {
    /// Anything but air.
    Anything,
    /// Any block with a collision box.
    Firm,
    /// Dirt, grass and the like, or farmland.
    Soil,
    /// Farmland.
    Farmland,
    /// What grows in shade or in the Nether: mycelium, podzol, nylium.
    Mycelium,
    /// Soul sand.
    SoulSand,
    /// Sand, terracotta or dirt.
    Desert,
    /// Water or ice.
    Water,
}

impl Ground {
    fn bears(self, below: StateId) -> bool {
        let name = below.block().name;
        match self {
            Self::Anything => !below.is_air(),
            Self::Firm => below.block().is_solid(),
            Self::Soil => is_dirt(name) || name == "farmland",
            Self::Farmland => name == "farmland",
            Self::Mycelium => matches!(name, "mycelium" | "podzol") || name.ends_with("_nylium"),
            Self::SoulSand => name == "soul_sand",
            Self::Desert => is_dirt(name) || is_sand(name) || name.ends_with("terracotta"),
            Self::Water => matches!(name, "water" | "ice" | "frosted_ice"),
        }
    }
}

/// Returns whether a block is earth in which plants grow.
fn is_dirt(name: &str) -> bool {
    matches!(
        name,
        "dirt"
            | "grass_block"
            | "podzol"
            | "coarse_dirt"
            | "mycelium"
            | "rooted_dirt"
            | "moss_block"
            | "pale_moss_block"
            | "mud"
            | "muddy_mangrove_roots"
    )
}

fn is_sand(name: &str) -> bool {
    matches!(name, "sand" | "red_sand" | "suspicious_sand")
}

/// Returns what the block in a cell turns into a tick after it or a neighbour changed; none if it stays.
pub fn turns_into(world: &impl Blocks, cell: Cell) -> Option<&'static str> {
    let name = world.state(cell).block().name;
    let below = Side::Down.beside(cell);
    let under = world.state(below).block().name;
    let is_beside = |cell: Cell, accepts: fn(&str) -> bool| {
        [Side::West, Side::East, Side::North, Side::South]
            .iter()
            .any(|side| accepts(world.state(side.beside(cell)).block().name))
    };
    match name {
        "farmland" | "dirt_path" => {
            let above = world.state(Side::Up.beside(cell)).block();
            (above.is_solid() && !above.name.ends_with("_fence_gate")).then_some("dirt")
        }
        "sugar_cane" => {
            let is_wet =
                (is_dirt(under) || is_sand(under)) && is_beside(below, |name| matches!(name, "water" | "frosted_ice"));
            (under != "sugar_cane" && !is_wet).then_some("air")
        }
        "cactus" => {
            let is_crowded = is_beside(cell, |name| Block::named(name).is_some_and(Block::is_solid));
            (is_crowded || !(under == "cactus" || is_sand(under))).then_some("air")
        }
        "bamboo" => {
            let bears = is_dirt(under)
                || is_sand(under)
                || matches!(under, "bamboo" | "bamboo_sapling" | "gravel" | "suspicious_gravel");
            (!bears).then_some("air")
        }
        _ => None,
    }
}

/// Returns whether what a block needs beside it is there; the other half of a block does not count.
pub fn is_held(world: &impl Blocks, cell: Cell, state: StateId) -> bool {
    needs(state).into_iter().flatten().all(|need| match need {
        Need::Half(..) => true,
        Need::Hold(side) => holds(world.state(side.beside(cell))),
        Need::Ground(ground) => ground.bears(world.state(Side::Down.beside(cell))),
    })
}

/// Returns whether the block in a cell breaks after its neighbour on a side changed.
pub fn breaks_after(world: &impl Blocks, cell: Cell, changed: Side) -> bool {
    let state = world.state(cell);
    if state.is_air() {
        return false;
    }
    needs(state).into_iter().flatten().any(|need| match need {
        Need::Half(side, property) => {
            side == changed && !is_other_half(state, world.state(side.beside(cell)), property)
        }
        Need::Hold(side) => side == changed && !holds(world.state(side.beside(cell))),
        Need::Ground(ground) => !ground.bears(world.state(Side::Down.beside(cell))),
    })
}

/// Returns whether a block can hold another one: what has a collision box can, but leaves, and what is lower than a
/// block.
fn holds(state: StateId) -> bool {
    let block = state.block();
    block.is_solid() && !block.name.ends_with("_leaves") && !matches!(block.name, "farmland" | "dirt_path")
}

fn is_other_half(state: StateId, other: StateId, property: &str) -> bool {
    let is_same = other.block().number == state.block().number
        || (property == "half" && [state, other].iter().all(|state| state.block().name.ends_with("_door")));
    is_same && other.get(property) != state.get(property)
}

fn needs(state: StateId) -> [Option<Need>; 2] {
    let name = state.block().name;
    let hold = |side| [Some(Need::Hold(side)), None];
    let facing = || state.get("facing").and_then(Side::named);
    let on_its_back = || [facing().map(|side| Need::Hold(side.opposite())), None];
    if name.ends_with("_door") {
        return match state.get("half") {
            Some("lower") => [Some(Need::Half(Side::Up, "half")), Some(Need::Hold(Side::Down))],
            _ => [Some(Need::Half(Side::Down, "half")), None],
        };
    }
    if name.ends_with("_bed") {
        let side = facing().map(|side| if state.get("part") == Some("head") { side.opposite() } else { side });
        return [side.map(|side| Need::Half(side, "part")), None];
    }
    if is_double_plant(name) {
        return match state.get("half") {
            Some("lower") => [Some(Need::Half(Side::Up, "half")), Some(Need::Ground(Ground::Soil))],
            _ => [Some(Need::Half(Side::Down, "half")), None],
        };
    }
    if let Some(ground) = ground_of(name) {
        return [Some(Need::Ground(ground)), None];
    }
    match name {
        "torch" | "soul_torch" | "redstone_torch" | "redstone_wire" | "repeater" | "comparator" | "rail"
        | "powered_rail" | "detector_rail" | "activator_rail" | "cake" => hold(Side::Down),
        "wall_torch" | "soul_wall_torch" | "redstone_wall_torch" | "ladder" | "tripwire_hook" => on_its_back(),
        "lever" => face(state),
        "lantern" | "soul_lantern" => hold(if state.get("hanging") == Some("true") { Side::Up } else { Side::Down }),
        "bell" => match state.get("attachment") {
            Some("floor") => hold(Side::Down),
            Some("ceiling") => hold(Side::Up),
            Some("single_wall") => [facing().map(Need::Hold), None],
            _ => [None, None],
        },
        "spore_blossom"
        | "hanging_roots"
        | "weeping_vines"
        | "weeping_vines_plant"
        | "cave_vines"
        | "cave_vines_plant" => hold(Side::Up),
        _ if name.ends_with("_button") => face(state),
        _ if name.ends_with("_wall_hanging_sign") => [None, None],
        _ if name.ends_with("_hanging_sign") => hold(Side::Up),
        _ if name.ends_with("_wall_sign") || name.ends_with("_wall_banner") || name.ends_with("_wall_fan") => {
            on_its_back()
        }
        _ if name.ends_with("_sign") || name.ends_with("_banner") || name.ends_with("_pressure_plate") => {
            hold(Side::Down)
        }
        _ => [None, None],
    }
}

/// What plants, carpets and snow stand on.
fn ground_of(name: &str) -> Option<Ground> {
    Some(match name {
        "snow" => Ground::Firm,
        "moss_carpet" | "pale_moss_carpet" => Ground::Anything,
        "lily_pad" => Ground::Water,
        "wheat"
        | "carrots"
        | "potatoes"
        | "beetroots"
        | "torchflower_crop"
        | "melon_stem"
        | "pumpkin_stem"
        | "attached_melon_stem"
        | "attached_pumpkin_stem" => Ground::Farmland,
        "nether_wart" => Ground::SoulSand,
        "brown_mushroom" | "red_mushroom" => Ground::Mycelium,
        "dead_bush" => Ground::Desert,
        "short_grass" | "fern" | "dandelion" | "poppy" | "blue_orchid" | "allium" | "azure_bluet" | "oxeye_daisy"
        | "cornflower" | "lily_of_the_valley" | "torchflower" | "sweet_berry_bush" | "azalea" | "flowering_azalea"
        | "pink_petals" | "open_eyeblossom" | "closed_eyeblossom" => Ground::Soil,
        _ if name.ends_with("_carpet") => Ground::Anything,
        _ if name.starts_with("potted_") => return None,
        _ if name == "bamboo_sapling" => Ground::Desert,
        _ if name.ends_with("_sapling") || name.ends_with("_tulip") => Ground::Soil,
        _ => return None,
    })
}

/// What a button or a lever holds on to.
fn face(state: StateId) -> [Option<Need>; 2] {
    let side = match state.get("face") {
        Some("floor") => Some(Side::Down),
        Some("ceiling") => Some(Side::Up),
        _ => state.get("facing").and_then(Side::named).map(Side::opposite),
    };
    [side.map(Need::Hold), None]
}

/// Returns whether a plant is two blocks high.
fn is_double_plant(name: &str) -> bool {
    matches!(
        name,
        "tall_grass" | "large_fern" | "sunflower" | "lilac" | "rose_bush" | "peony" | "tall_seagrass" | "pitcher_plant"
    )
}
