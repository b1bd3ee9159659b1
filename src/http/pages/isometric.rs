//! Isometric pictures of builds as SVG, for pages without scripts.

use std::fmt::Write as _;

use super::colours;
use plumbline_engine::voxel::{Cell, Structure};

/// Greatest number of blocks drawn: a picture of more blocks is a large file and shows less.
const MOST: usize = 30_000;
/// Half the width of a block, in SVG units.
const HALF_WIDTH: i32 = 10;
/// Vertical offset of one step on the ground, a quarter of a block's width, in SVG units.
const QUARTER: i32 = 5;
/// Height of a block, in SVG units.
const HEIGHT: i32 = 12;

/// Draws a structure; beyond `MOST` blocks, only the first ones.
#[must_use]
pub fn svg(structure: &Structure) -> String {
    let all = structure.len();
    let mut blocks: Vec<(Cell, &str)> =
        structure.cells().iter().take(MOST).enumerate().map(|(i, cell)| (*cell, structure.material(i))).collect();
    let cells: std::collections::HashSet<Cell> = blocks.iter().map(|(cell, _)| *cell).collect();
    // Farthest first, so that nearer blocks cover those behind them.
    blocks.sort_by_key(|(cell, _)| (cell.x + cell.y + cell.z, cell.y, cell.x));
    let point = |x: i32, y: i32, z: i32| ((x - z) * HALF_WIDTH, (x + z) * QUARTER - y * HEIGHT);
    let (mut low, mut high) = ((i32::MAX, i32::MAX), (i32::MIN, i32::MIN));
    let mut faces = String::new();
    for (Cell { x, y, z }, material) in &blocks {
        let (x, y, z) = (*x, *y, *z);
        let is_free = |dx: i32, dy: i32, dz: i32| !cells.contains(&Cell { x: x + dx, y: y + dy, z: z + dz });
        let sides = [
            (is_free(0, 1, 0), 100, [(0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)]),
            (is_free(0, 0, 1), 80, [(0, 1, 1), (1, 1, 1), (1, 0, 1), (0, 0, 1)]),
            (is_free(1, 0, 0), 64, [(1, 1, 0), (1, 1, 1), (1, 0, 1), (1, 0, 0)]),
        ];
        for (_, light, corners) in sides.into_iter().filter(|(is_free, ..)| *is_free) {
            let [r, g, b] = colours::of(material).map(|part| u32::from(part) * light / 100);
            let _ = write!(faces, "<path fill=\"#{r:02x}{g:02x}{b:02x}\" d=\"M");
            for (dx, dy, dz) in corners {
                let (px, py) = point(x + dx, y + dy, z + dz);
                low = (low.0.min(px), low.1.min(py));
                high = (high.0.max(px), high.1.max(py));
                let _ = write!(faces, "{px} {py} ");
            }
            faces.push_str("z\"/>");
        }
    }
    if blocks.is_empty() {
        (low, high) = ((0, 0), (80, 60));
        faces.push_str("<text x=\"40\" y=\"34\" text-anchor=\"middle\" font-size=\"9\" fill=\"#888\">no blocks</text>");
    }
    let (width, height) = (high.0 - low.0, high.1 - low.1);
    let note = if all > MOST { format!("<title>the first {MOST} of {all} blocks</title>") } else { String::new() };
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{} {} {} {}\" stroke=\"#0003\" stroke-width=\".6\" \
         stroke-linejoin=\"round\">{note}{faces}</svg>",
        low.0 - 4,
        low.1 - 4,
        width + 8,
        height + 8
    )
}
