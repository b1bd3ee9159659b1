//! Block tags of the game whose members follow from their names.

/// Patterns of the blocks of all kinds of wood whose names end alike.
macro_rules! of_woods {
    ($end:literal) => {
        &[
            concat!("oak", $end),
            concat!("spruce", $end),
            concat!("birch", $end),
            concat!("jungle", $end),
            concat!("acacia", $end),
            concat!("dark_oak", $end),
            concat!("pale_oak", $end),
            concat!("mangrove", $end),
            concat!("cherry", $end),
            concat!("bamboo", $end),
            concat!("crimson", $end),
            concat!("warped", $end),
        ]
    };
}

/// Patterns of the logs of a kind of wood.
macro_rules! logs_of {
    ($wood:literal) => {
        &[
            concat!($wood, "_log"),
            concat!($wood, "_wood"),
            concat!("stripped_", $wood, "_log"),
            concat!("stripped_", $wood, "_wood"),
        ]
    };
}

/// Tags with the patterns of their members. `*` at the beginning or the end of a pattern stands for anything; `!`
/// before a pattern takes its names out again.
const TAGS: &[(&str, &[&str])] = &[
    ("acacia_logs", logs_of!("acacia")),
    ("air", &["air", "cave_air", "void_air"]),
    ("all_hanging_signs", &["*_hanging_sign"]),
    ("all_signs", &["*_sign"]),
    ("anvil", &["anvil", "chipped_anvil", "damaged_anvil"]),
    ("banners", &["*_banner"]),
    ("bamboo_blocks", &["bamboo_block", "stripped_bamboo_block"]),
    ("base_stone_overworld", &["stone", "granite", "diorite", "andesite", "tuff", "deepslate"]),
    ("beds", &["*_bed"]),
    ("birch_logs", logs_of!("birch")),
    ("buttons", &["*_button"]),
    ("campfires", &["campfire", "soul_campfire"]),
    ("candle_cakes", &["*candle_cake"]),
    ("candles", &["candle", "*_candle"]),
    ("cauldrons", &["cauldron", "*_cauldron"]),
    ("ceiling_hanging_signs", &["*_hanging_sign", "!*_wall_hanging_sign"]),
    ("cherry_logs", logs_of!("cherry")),
    ("coal_ores", &["*coal_ore"]),
    ("concrete_powder", &["*_concrete_powder"]),
    ("copper_ores", &["*copper_ore"]),
    (
        "crops",
        &[
            "wheat",
            "carrots",
            "potatoes",
            "beetroots",
            "melon_stem",
            "pumpkin_stem",
            "torchflower_crop",
            "pitcher_crop",
        ],
    ),
    ("crimson_stems", &["crimson_stem", "stripped_crimson_stem", "crimson_hyphae", "stripped_crimson_hyphae"]),
    ("dark_oak_logs", logs_of!("dark_oak")),
    ("diamond_ores", &["*diamond_ore"]),
    (
        "dirt",
        &[
            "dirt",
            "grass_block",
            "podzol",
            "coarse_dirt",
            "mycelium",
            "rooted_dirt",
            "moss_block",
            "pale_moss_block",
            "mud",
            "muddy_mangrove_roots",
        ],
    ),
    ("doors", &["*_door"]),
    ("emerald_ores", &["*emerald_ore"]),
    ("fence_gates", &["*_fence_gate"]),
    ("fences", &["*_fence"]),
    ("fire", &["fire", "soul_fire"]),
    ("flower_pots", &["flower_pot", "potted_*"]),
    ("gold_ores", &["*gold_ore"]),
    ("ice", &["ice", "packed_ice", "blue_ice", "frosted_ice"]),
    ("iron_ores", &["*iron_ore"]),
    ("jungle_logs", logs_of!("jungle")),
    ("lapis_ores", &["*lapis_ore"]),
    ("leaves", &["*_leaves"]),
    (
        "logs",
        &[
            "*_log",
            "*_wood",
            "crimson_stem",
            "warped_stem",
            "stripped_crimson_stem",
            "stripped_warped_stem",
            "*_hyphae",
        ],
    ),
    ("mangrove_logs", logs_of!("mangrove")),
    ("oak_logs", logs_of!("oak")),
    ("pale_oak_logs", logs_of!("pale_oak")),
    ("planks", &["*_planks"]),
    ("pressure_plates", &["*_pressure_plate"]),
    ("rails", &["rail", "*_rail"]),
    ("redstone_ores", &["*redstone_ore"]),
    (
        "replaceable",
        &[
            "air",
            "cave_air",
            "void_air",
            "water",
            "lava",
            "bubble_column",
            "short_grass",
            "fern",
            "tall_grass",
            "large_fern",
            "dead_bush",
            "seagrass",
            "tall_seagrass",
            "fire",
            "soul_fire",
            "snow",
            "vine",
            "glow_lichen",
            "resin_clump",
            "crimson_roots",
            "warped_roots",
            "nether_sprouts",
            "hanging_roots",
            "light",
            "structure_void",
        ],
    ),
    ("sand", &["sand", "red_sand", "suspicious_sand"]),
    ("saplings", &["*_sapling", "!bamboo_sapling", "!potted_*", "azalea", "flowering_azalea", "mangrove_propagule"]),
    ("shulker_boxes", &["shulker_box", "*_shulker_box"]),
    ("signs", &["*_sign", "!*_hanging_sign"]),
    ("slabs", &["*_slab"]),
    (
        "small_flowers",
        &[
            "dandelion",
            "poppy",
            "blue_orchid",
            "allium",
            "azure_bluet",
            "*_tulip",
            "!potted_*",
            "oxeye_daisy",
            "cornflower",
            "lily_of_the_valley",
            "wither_rose",
            "torchflower",
            "open_eyeblossom",
            "closed_eyeblossom",
        ],
    ),
    ("snow", &["snow", "snow_block", "powder_snow"]),
    ("spruce_logs", logs_of!("spruce")),
    ("stairs", &["*_stairs"]),
    ("standing_signs", &["*_sign", "!*_wall_sign", "!*_hanging_sign"]),
    ("stone_bricks", &["stone_bricks", "mossy_stone_bricks", "cracked_stone_bricks", "chiseled_stone_bricks"]),
    ("stone_buttons", &["stone_button", "polished_blackstone_button"]),
    ("stone_pressure_plates", &["stone_pressure_plate", "polished_blackstone_pressure_plate"]),
    ("terracotta", &["terracotta", "*_terracotta", "!*_glazed_terracotta"]),
    ("trapdoors", &["*_trapdoor"]),
    ("wall_hanging_signs", &["*_wall_hanging_sign"]),
    ("wall_signs", &["*_wall_sign"]),
    ("walls", &["*_wall"]),
    ("warped_stems", &["warped_stem", "stripped_warped_stem", "warped_hyphae", "stripped_warped_hyphae"]),
    ("wooden_buttons", of_woods!("_button")),
    ("wooden_doors", of_woods!("_door")),
    ("wooden_fences", of_woods!("_fence")),
    ("wooden_pressure_plates", of_woods!("_pressure_plate")),
    ("wooden_slabs", of_woods!("_slab")),
    ("wooden_stairs", of_woods!("_stairs")),
    ("wooden_trapdoors", of_woods!("_trapdoor")),
    ("wool", &["*_wool"]),
    ("wool_carpets", &["*_carpet", "!moss_carpet", "!pale_moss_carpet"]),
];

/// Returns the patterns of a tag without its namespace, if it is known.
pub fn patterns_of(tag: &str) -> Option<&'static [&'static str]> {
    TAGS.iter().find(|(known, _)| *known == tag).map(|(_, patterns)| *patterns)
}

/// Returns whether a block is among those that patterns describe.
pub fn has(patterns: &[&str], name: &str) -> bool {
    let is_out = patterns.iter().filter_map(|pattern| pattern.strip_prefix('!')).any(|pattern| matches(pattern, name));
    !is_out && patterns.iter().any(|pattern| matches(pattern, name))
}

fn matches(pattern: &str, name: &str) -> bool {
    match (pattern.strip_prefix('*'), pattern.strip_suffix('*')) {
        (Some(end), _) => name.ends_with(end),
        (None, Some(begin)) => name.starts_with(begin),
        (None, None) => name == pattern,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::game::registry::Block;

    #[test]
    fn tags_have_as_many_members_as_in_the_game() {
        for (tag, count) in [
            ("logs", 44),
            ("planks", 12),
            ("wool", 16),
            ("wool_carpets", 16),
            ("leaves", 11),
            ("slabs", 62),
            ("stairs", 58),
            ("doors", 21),
            ("trapdoors", 21),
            ("beds", 16),
            ("banners", 32),
            ("candles", 17),
            ("fences", 13),
            ("fence_gates", 12),
            ("walls", 26),
            ("buttons", 14),
            ("pressure_plates", 16),
            ("signs", 24),
            ("saplings", 11),
            ("terracotta", 17),
            ("rails", 4),
            ("shulker_boxes", 17),
            ("dark_oak_logs", 4),
            ("standing_signs", 12),
            ("wall_signs", 12),
            ("ceiling_hanging_signs", 12),
            ("wooden_doors", 12),
            ("wooden_stairs", 12),
        ] {
            let patterns = patterns_of(tag).unwrap();
            let members = Block::all().iter().filter(|block| has(patterns, block.name)).count();
            assert_eq!(members, count, "{tag}");
        }
        for (_, patterns) in TAGS {
            for pattern in *patterns {
                let pattern = pattern.trim_start_matches('!');
                assert!(Block::all().iter().any(|block| matches(pattern, block.name)), "{pattern} is no block");
            }
        }
    }
}
