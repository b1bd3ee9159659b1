//! The blocks of Minecraft 1.21.4 (Java edition): their names, the families that strict checks use, and which blocks a
//! player can walk through.
//!
//! `blocks.txt` lists every block of that version; `passable` marks the blocks without a collision box. The data are
//! the game's own, as listed in the data sets of bot frameworks.

use std::collections::HashMap;
use std::fmt;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

/// Version of Minecraft whose blocks are listed.
pub const GAME_VERSION: &str = "1.21.4";

/// Maps the name of each block to whether a player can walk through it.
static BLOCKS: LazyLock<HashMap<&'static str, bool, foldhash::fast::RandomState>> = LazyLock::new(|| {
    let line = |line: &'static str| match line.split_once(' ') {
        Some((name, _passable)) => (name, true),
        None => (line, false),
    };
    include_str!("blocks.txt").lines().map(line).collect()
});

/// Strips the `minecraft:` namespace and the block state: `minecraft:oak_stairs[facing=east]` becomes `oak_stairs`.
#[must_use]
pub fn canonical(name: &str) -> &str {
    let name = name.strip_prefix("minecraft:").unwrap_or(name);
    if !name.ends_with(']') {
        return name;
    }
    name.split_once('[').map_or(name, |(block, _)| block)
}

/// Returns the names of all blocks of the game, in no particular order.
pub fn names() -> impl Iterator<Item = &'static str> {
    BLOCKS.keys().copied()
}

/// Returns whether Minecraft has a block of this name.
#[must_use]
pub fn is_known(name: &str) -> bool {
    BLOCKS.contains_key(canonical(name))
}

/// Returns whether this is the name of a kind of air.
#[must_use]
pub fn is_air(name: &str) -> bool {
    matches!(canonical(name), "air" | "cave_air" | "void_air")
}

/// Returns whether a player can walk through the block, such as a torch, and therefore can neither stand on it nor be
/// blocked by it. Doors do not count as passable: see [`is_door`].
#[must_use]
pub fn is_passable(name: &str) -> bool {
    BLOCKS.get(canonical(name)).copied().unwrap_or(false)
}

/// Returns whether the block is a door. Trapdoors are not doors.
#[must_use]
pub fn is_door(name: &str) -> bool {
    is_known(name) && canonical(name).ends_with("_door")
}

/// Returns whether the block is a bed.
#[must_use]
pub fn is_bed(name: &str) -> bool {
    is_known(name) && canonical(name).ends_with("_bed")
}

/// Returns whether the block is so thin that a player walks over it as over the floor below it, such as a carpet.
#[must_use]
pub fn is_thin(name: &str) -> bool {
    let name = canonical(name);
    name.ends_with("_carpet") || matches!(name, "lily_pad" | "repeater" | "comparator")
}

/// Returns whether a player can climb in the block, such as a ladder.
#[must_use]
pub fn is_climbable(name: &str) -> bool {
    let climbable = ["ladder", "vine", "scaffolding", "twisting_vines", "weeping_vines", "cave_vines"];
    let name = canonical(name);
    climbable.contains(&name.strip_suffix("_plant").unwrap_or(name))
}

/// Returns whether something can be built of the block: none that a player passes through, such as water and torches,
/// walks over, such as a carpet, or climbs in, and no door.
#[must_use]
pub fn is_structural(name: &str) -> bool {
    !is_passable(name) && !is_thin(name) && !is_climbable(name) && !is_door(name)
}

/// The naming rule that defines the members of a block family.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Spelling {
    /// The name ends with this suffix.
    Ends(&'static str),
    /// The block is made of this wood: planks, logs, stairs and so on.
    Wood(&'static str),
    /// The block is dyed in this colour.
    Dyed(&'static str),
    /// A player can walk through the block.
    Passable,
}

/// The block families, spelled like the game's own tags where it has them.
const FAMILIES: &[(&str, Spelling)] = &[
    ("#beds", Spelling::Ends("_bed")),
    ("#doors", Spelling::Ends("_door")),
    ("#stairs", Spelling::Ends("_stairs")),
    ("#slabs", Spelling::Ends("_slab")),
    ("#planks", Spelling::Ends("_planks")),
    ("#wool", Spelling::Ends("_wool")),
    ("#concrete", Spelling::Ends("_concrete")),
    ("#terracotta", Spelling::Ends("_terracotta")),
    ("#oak", Spelling::Wood("oak")),
    ("#spruce", Spelling::Wood("spruce")),
    ("#birch", Spelling::Wood("birch")),
    ("#red", Spelling::Dyed("red")),
    ("#green", Spelling::Dyed("green")),
    ("#yellow", Spelling::Dyed("yellow")),
    ("#orange", Spelling::Dyed("orange")),
    ("#purple", Spelling::Dyed("purple")),
    ("#black", Spelling::Dyed("black")),
    ("#white", Spelling::Dyed("white")),
    ("#blue", Spelling::Dyed("blue")),
    ("#brown", Spelling::Dyed("brown")),
    ("#cyan", Spelling::Dyed("cyan")),
    ("#gray", Spelling::Dyed("gray")),
    ("#passable", Spelling::Passable),
];
/// Name suffixes of the blocks for walls and roofs that come in all sixteen dye colours.
const DYED: [&str; 6] =
    ["_wool", "_concrete", "_concrete_powder", "_terracotta", "_glazed_terracotta", "_stained_glass"];

impl Spelling {
    fn has(self, name: &str) -> bool {
        match self {
            Self::Ends(ending) => name.ends_with(ending),
            Self::Wood(wood) => {
                let bare = name.strip_prefix("stripped_").unwrap_or(name);
                bare.strip_prefix(wood).is_some_and(|rest| rest.starts_with('_'))
            }
            Self::Passable => is_passable(name),
            Self::Dyed(colour) => name.strip_prefix(colour).is_some_and(|rest| DYED.contains(&rest)),
        }
    }
}

/// The blocks that a check refers to: a single block by name, such as `stone`, or a family, such as `#beds`.
///
/// Unlike a substring, a family has no accidental members: bedrock is not a bed, a trapdoor is not a door, and dark oak
/// is not oak.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct BlockSet(Members);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Members {
    /// The block of this name.
    One(&'static str),
    /// The family at this index of `FAMILIES`.
    Family(usize),
}

impl BlockSet {
    /// Returns whether the block of this name belongs to the set.
    #[must_use]
    pub fn has(self, name: &str) -> bool {
        let name = canonical(name);
        match self.0 {
            Members::One(own) => own == name,
            Members::Family(index) => BLOCKS.contains_key(name) && FAMILIES[index].1.has(name),
        }
    }

    /// Returns an example member: the first block of the set in alphabetical order.
    #[must_use]
    pub fn example(self) -> &'static str {
        match self.0 {
            Members::One(name) => name,
            Members::Family(_) => BLOCKS.keys().filter(|name| self.has(name)).min().map_or("stone", |name| *name),
        }
    }

    /// Returns the names of all families.
    pub fn families() -> impl Iterator<Item = &'static str> {
        FAMILIES.iter().map(|(name, _)| *name)
    }
}

impl fmt::Display for BlockSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Members::One(name) => f.write_str(name),
            Members::Family(index) => f.write_str(FAMILIES[index].0),
        }
    }
}

impl From<BlockSet> for String {
    fn from(set: BlockSet) -> Self {
        set.to_string()
    }
}

impl TryFrom<String> for BlockSet {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        if name.starts_with('#') {
            let known = || BlockSet::families().collect::<Vec<_>>().join(", ");
            let index = FAMILIES.iter().position(|(family, _)| *family == name);
            return index
                .map(|index| Self(Members::Family(index)))
                .ok_or_else(|| format!("unknown block family {name:?}; known families: {}", known()));
        }
        let known = BLOCKS.get_key_value(name.as_str()).map(|(known, _)| Self(Members::One(known)));
        known.ok_or_else(|| format!("Minecraft {GAME_VERSION} has no block {name:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(name: &str) -> BlockSet {
        BlockSet::try_from(name.to_owned()).unwrap()
    }

    #[test]
    fn families_have_no_members_by_accident() {
        for (family, members, others) in [
            ("#beds", &["red_bed", "minecraft:white_bed[part=head]"][..], &["bedrock", "bed", "pink_bedding"][..]),
            ("#doors", &["oak_door", "iron_door", "waxed_copper_door"], &["oak_trapdoor", "door"]),
            (
                "#oak",
                &["oak_planks", "oak_stairs", "stripped_oak_log"],
                &["dark_oak_planks", "pale_oak_planks", "oakum"],
            ),
            ("#red", &["red_wool", "red_concrete"], &["redstone_block", "red_sandstone", "red_mushroom"]),
            ("#concrete", &["gray_concrete"], &["gray_concrete_powder"]),
            ("#passable", &["water", "torch", "light", "minecraft:fire"], &["stone", "oak_door", "lantern"]),
            ("stone", &["stone", "minecraft:stone"], &["cobblestone", "stone_bricks", "Stone"]),
        ] {
            assert!(members.iter().all(|name| set(family).has(name)), "{family}");
            assert!(others.iter().all(|name| !set(family).has(name)), "{family}");
        }
    }

    #[test]
    fn every_family_has_members_and_unknown_names_are_told() {
        for family in BlockSet::families() {
            assert!(BLOCKS.keys().any(|name| set(family).has(name)), "{family}");
        }
        assert!(BlockSet::try_from("#boats".to_owned()).unwrap_err().contains("#beds"));
        assert!(BlockSet::try_from("Stone".to_owned()).is_err());
        assert_eq!(BLOCKS.len(), 1_095);
        assert!(is_passable("torch") && is_passable("air") && !is_passable("stone") && !is_passable("no_such_block"));
    }
}
