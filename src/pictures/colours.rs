//! Colours of materials in pictures: close to the block's own colour if its name is recognized, otherwise derived from
//! a hash of the name.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

/// Parts of block names with their colours; the first part that a name contains applies.
const KNOWN: [(&str, [u8; 3]); 34] = [
    ("dark_oak", [74, 49, 25]),
    ("oak", [172, 139, 87]),
    ("spruce", [115, 85, 49]),
    ("birch", [207, 192, 139]),
    ("jungle", [160, 115, 80]),
    ("acacia", [186, 99, 55]),
    ("mangrove", [119, 54, 49]),
    ("cherry", [228, 178, 172]),
    ("bamboo", [194, 173, 80]),
    ("sandstone", [216, 203, 156]),
    ("sand", [219, 207, 163]),
    ("deepslate", [80, 80, 84]),
    ("blackstone", [42, 36, 41]),
    ("cobblestone", [128, 127, 128]),
    ("stone_brick", [122, 122, 122]),
    ("stone", [136, 136, 137]),
    ("brick", [151, 98, 83]),
    ("quartz", [236, 230, 223]),
    ("iron", [220, 220, 220]),
    ("gold", [246, 208, 62]),
    ("diamond", [98, 237, 228]),
    ("copper", [192, 108, 80]),
    ("concrete", [150, 150, 150]),
    ("glass", [176, 214, 219]),
    ("ice", [146, 185, 254]),
    ("snow", [249, 254, 254]),
    ("dirt", [134, 96, 67]),
    ("grass", [109, 153, 48]),
    ("obsidian", [20, 18, 30]),
    ("bed", [163, 45, 41]),
    ("door", [140, 110, 60]),
    ("torch", [255, 210, 90]),
    ("lantern", [240, 160, 70]),
    ("wool", [234, 236, 237]),
];

/// Returns the colour of a material as red, green and blue.
#[must_use]
pub fn of(material: &str) -> [u8; 3] {
    let known = KNOWN.iter().find(|(part, _)| material.contains(part)).map(|(_, colour)| *colour);
    known.unwrap_or_else(|| {
        // `DefaultHasher::new` uses fixed keys, so every process derives the same colour.
        let mut hasher = DefaultHasher::new();
        material.hash(&mut hasher);
        let [a, b, c, ..] = hasher.finish().to_le_bytes();
        [a, b, c].map(|byte| 70 + byte / 2)
    })
}

/// Returns the colour of a material as `#rrggbb`.
#[must_use]
pub fn hex(material: &str) -> String {
    let [r, g, b] = of(material);
    format!("#{r:02x}{g:02x}{b:02x}")
}
