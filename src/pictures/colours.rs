//! How blocks look in pictures: their colours and their boxes, from `data/blocks.txt`.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::LazyLock;

/// Colour as red, green and blue.
pub type Colour = [u8; 3];
/// A box inside a block, in sixteenths of the block: the least corner and the greatest.
pub type Box3 = [u8; 6];

/// The box of a whole block.
pub const WHOLE: Box3 = [0, 0, 0, 16, 16, 16];

/// How a block looks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Look {
    /// Mean colour of its top.
    pub top: Colour,
    /// Mean colour of its sides.
    pub side: Colour,
    /// Boxes of its default state; none if it fills its cell.
    pub boxes: Vec<Box3>,
}

static LOOKS: LazyLock<HashMap<&str, Look>> = LazyLock::new(|| {
    let table = include_str!("data/blocks.txt").lines();
    table.map(|line| read(line).expect("the table has a name, two colours and boxes in each line")).collect()
});

fn read(line: &str) -> Option<(&str, Look)> {
    let mut parts = line.split(' ');
    let (name, top, side) = (parts.next()?, parts.next()?, parts.next()?);
    let colour = |text: &str| -> Option<Colour> {
        let number = u32::from_str_radix(text, 16).ok()?;
        Some([(number >> 16) as u8, (number >> 8) as u8, number as u8])
    };
    let read_box = |text: &str| -> Option<Box3> {
        let numbers: Result<Vec<u8>, _> = text.split(',').map(str::parse).collect();
        numbers.ok()?.try_into().ok()
    };
    let boxes: Option<Vec<Box3>> = parts.map(read_box).collect();
    Some((name, Look { top: colour(top)?, side: colour(side)?, boxes: boxes? }))
}

/// Returns how a block looks, by its name with or without `minecraft:` and a state. A name that is not the game's gets
/// a colour of its own, the same everywhere.
#[must_use]
pub fn look(name: &str) -> Look {
    let plain = name.strip_prefix("minecraft:").unwrap_or(name);
    let plain = plain.split('[').next().unwrap_or(plain);
    LOOKS.get(plain).cloned().unwrap_or_else(|| {
        // `DefaultHasher::new` uses fixed keys, so every process derives the same colour.
        let mut hasher = DefaultHasher::new();
        plain.hash(&mut hasher);
        let [a, b, c, ..] = hasher.finish().to_le_bytes();
        let colour = [a, b, c].map(|byte| 70 + byte / 2);
        Look { top: colour, side: colour, boxes: Vec::new() }
    })
}

/// Returns the mean colour of a block.
#[must_use]
pub fn of(name: &str) -> Colour {
    let Look { top, side, .. } = look(name);
    std::array::from_fn(|part| u8::midpoint(top[part], side[part]))
}

/// Returns the mean colour of a block as `#rrggbb`.
#[must_use]
pub fn hex(name: &str) -> String {
    let [r, g, b] = of(name);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::game::registry::Block;

    #[test]
    fn every_block_of_the_game_has_a_look() {
        let unseen = ["air", "cave_air", "void_air", "barrier", "light", "structure_void"];
        for name in Block::all().iter().map(|block| block.name) {
            assert_eq!(LOOKS.contains_key(name), !unseen.contains(&name), "{name}");
        }
        for name in Block::all().iter().map(|block| block.name).filter(|name| !unseen.contains(name)) {
            let look = look(name);
            for [x, y, z, dx, dy, dz] in &look.boxes {
                assert!(x < dx && y < dy && z < dz && *dx.max(dy).max(dz) <= 16, "{name}: {look:?}");
            }
        }
    }

    /// Distance of two colours: 0 to 441.
    fn distance(a: Colour, b: Colour) -> f64 {
        (0..3).map(|part| (f64::from(a[part]) - f64::from(b[part])).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn colours_are_those_that_players_know() {
        // As the game's dyes and maps have them, so only near; a wrong guess by name is farther off.
        for (name, colour) in [
            ("white_wool", [249, 255, 254]),
            ("orange_wool", [249, 128, 29]),
            ("red_wool", [176, 46, 38]),
            ("blue_wool", [60, 68, 170]),
            ("black_wool", [29, 29, 33]),
            ("lime_concrete", [94, 168, 24]),
            ("white_concrete", [207, 213, 214]),
            ("blue_bed", [60, 68, 170]),
            ("bedrock", [85, 85, 85]),
            ("redstone_block", [176, 25, 6]),
            ("red_sandstone", [187, 99, 29]),
            ("sandstone", [217, 204, 156]),
            ("stone", [125, 125, 125]),
            ("diamond_block", [98, 237, 228]),
            ("minecraft:gold_block", [246, 208, 61]),
            ("snow_block", [249, 254, 254]),
            ("nether_bricks", [44, 22, 26]),
            ("oak_stairs[half=top]", [162, 131, 79]),
        ] {
            assert!(distance(of(name), colour) < 40.0, "{name}: {:?}", of(name));
        }
        assert_eq!(look("oak_slab").boxes, [[0, 0, 0, 16, 8, 16]]);
        assert!(look("stone").boxes.is_empty());
    }
}
