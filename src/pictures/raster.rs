//! Pictures as PNG, for agents that see and for previews of pages.

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{Options, Tree};

/// Colour behind everything.
const SKY: (u8, u8, u8) = (214, 230, 244);

/// Reason why a picture cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum RasterError {
    /// The SVG cannot be read.
    #[error("not an SVG: {0}")]
    Svg(#[from] resvg::usvg::Error),
    /// The picture has no pixels.
    #[error("a picture of {0} × {1} pixels")]
    Size(u32, u32),
    /// The pixels cannot be written.
    #[error("the picture cannot be written: {0}")]
    Png(String),
}

/// Draws an SVG as PNG whose longer side has this many pixels.
///
/// # Errors
/// Returns an error if the SVG cannot be read, or the PNG cannot be written.
pub fn png(svg: &str, longer_side: u32) -> Result<Vec<u8>, RasterError> {
    let tree = Tree::from_str(svg, &Options::default())?;
    let size = tree.size();
    let scale = longer_side as f32 / size.width().max(size.height());
    let [width, height] = [size.width(), size.height()].map(|side| ((side * scale) as u32).clamp(1, longer_side));
    let mut pixels = Pixmap::new(width, height).ok_or(RasterError::Size(width, height))?;
    let (red, green, blue) = SKY;
    pixels.fill(Color::from_rgba8(red, green, blue, 255));
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| RasterError::Png(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::colours;
    use crate::pictures::isometric::{Corner, Scene, svg};

    fn image(blocks: &[([i32; 3], &str)], corner: Corner, has_ground: bool) -> Pixmap {
        let drawn = svg(&Scene { blocks: blocks.to_vec(), dug: Vec::new(), most: 10_000, corner, has_ground });
        Pixmap::decode_png(&png(&drawn, 640).unwrap()).unwrap()
    }

    fn count(image: &Pixmap, colour: [u8; 3]) -> usize {
        image.pixels().iter().filter(|pixel| [pixel.red(), pixel.green(), pixel.blue()] == colour).count()
    }

    #[test]
    fn nearer_blocks_cover_farther_ones() {
        let [gold, obsidian] = ["gold_block", "obsidian"].map(|name| colours::look(name).side);
        let wall = |x: i32, name| (0..3).flat_map(move |y| (0..3).map(move |z| ([x, y, z], name)));
        let both: Vec<_> = wall(0, "gold_block").chain(wall(1, "obsidian")).collect();
        // From the south-east the wall at x = 1 is in front, from the north-west the one at x = 0.
        let side = |colour: [u8; 3]| colour.map(|part| (u32::from(part) * 64 / 100) as u8);
        let front = image(&both, Corner::SouthEast, true);
        assert_eq!(count(&front, side(gold)), 0);
        assert!(count(&front, side(obsidian)) > 500);
        let back = image(&both, Corner::NorthWest, true);
        assert_eq!(count(&back, side(obsidian)), 0);
        assert!(count(&back, side(gold)) > 500);
    }

    #[test]
    fn dug_ground_is_seen_and_far_builds_look_like_near_ones() {
        let ring = |x: i32| -> Vec<([i32; 3], &str)> {
            (0..5)
                .flat_map(|i| [[x + i, -1, 0], [x + i, -1, 4], [x, -1, i], [x + 4, -1, i]])
                .map(|at| (at, "stone"))
                .collect()
        };
        let drawn = |x: i32, dug: Vec<[i32; 3]>| {
            png(&svg(&Scene { blocks: ring(x), dug, most: 100, corner: Corner::SouthEast, has_ground: true }), 640)
                .unwrap()
        };
        let pit: Vec<[i32; 3]> = (1..4).flat_map(|x| (1..4).flat_map(move |z| [[x, -1, z], [x, -2, z]])).collect();
        assert_ne!(drawn(0, Vec::new()), drawn(0, pit));
        assert_eq!(drawn(0, Vec::new()), drawn(29_000_000, Vec::new()));
    }

    #[test]
    fn pictures_stay_within_their_size() {
        let sky = [SKY.0, SKY.1, SKY.2];
        for blocks in [
            vec![],
            vec![([0, 0, 0], "stone")],
            vec![([0, -2048, 0], "stone"), ([0, 2047, 0], "stone")],
            vec![([-30_000_000, 0, 0], "stone"), ([30_000_000, 0, 30_000_000], "stone")],
            (0..300).map(|x| ([x, 0, -x], "stone")).collect(),
        ] {
            for corner in [Corner::SouthEast, Corner::SouthWest, Corner::NorthWest, Corner::NorthEast] {
                let image = image(&blocks, corner, true);
                assert!(image.width().max(image.height()) <= 640, "{} {}", image.width(), image.height());
                assert!(blocks.len() != 1 || count(&image, sky) < image.pixels().len());
            }
        }
    }
}
