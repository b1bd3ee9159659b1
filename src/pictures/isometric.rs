//! Builds seen from above and from a corner, without perspective, as SVG.

use std::collections::HashSet;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::colours;

/// Greatest number of blocks drawn: a picture of more blocks is a large file and shows less.
const MOST: usize = 30_000;
/// Half the width of a block, in SVG units.
const HALF_WIDTH: i32 = 10;
/// Vertical offset of one step on the ground, a quarter of a block's width, in SVG units.
const QUARTER: i32 = 5;
/// Height of a block, in SVG units.
const HEIGHT: i32 = 12;
/// Cells of ground around a build.
const MARGIN: i32 = 2;
/// Height of the uppermost layer of ground.
const GROUND_Y: i32 = -1;
/// Longest side of a build that is drawn with its ground, in cells.
const GROUND_SPAN: u32 = 128;
/// Colours of the ground: fields of two greens make distances countable.
const GROUND: [[u8; 3]; 2] = [[122, 168, 92], [114, 158, 86]];

/// Corner from which a build is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Corner {
    /// From the south-east: x grows to the lower right, z to the lower left.
    #[default]
    SouthEast,
    /// From the south-west.
    SouthWest,
    /// From the north-west.
    NorthWest,
    /// From the north-east.
    NorthEast,
}

impl Corner {
    /// Turns a cell so that the viewer is at the south-east.
    const fn turned(self, [x, y, z]: [i32; 3]) -> [i32; 3] {
        match self {
            Self::SouthEast => [x, y, z],
            Self::SouthWest => [z, y, -x],
            Self::NorthWest => [-x, y, -z],
            Self::NorthEast => [-z, y, x],
        }
    }
}

/// What to draw.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    /// Blocks, by their names without states; beyond `MOST`, only the first ones are drawn.
    pub blocks: Vec<([i32; 3], &'a str)>,
    /// Corner from which they are seen.
    pub corner: Corner,
    /// Whether the ground around the build is drawn.
    pub has_ground: bool,
}

/// A cell to draw.
struct Cube {
    at: [i32; 3],
    colour: [u8; 3],
}

impl Scene<'_> {
    /// Returns the cells to draw, from the farthest to the nearest, so that nearer ones cover those behind them.
    fn cubes(&self) -> Vec<Cube> {
        let drawn = self.blocks.iter().take(MOST);
        let mut cubes: Vec<Cube> =
            drawn.map(|(at, name)| Cube { at: self.corner.turned(*at), colour: colours::of(name) }).collect();
        if self.has_ground {
            let ground = ground_around(&cubes);
            cubes.extend(ground);
        }
        cubes.sort_by_key(|Cube { at: [x, y, z], .. }| (x + y + z, *y, *x));
        cubes
    }
}

/// Returns the cells of natural ground below and around some cells.
fn ground_around(cubes: &[Cube]) -> Vec<Cube> {
    let filled: HashSet<[i32; 3]> = cubes.iter().map(|cube| cube.at).collect();
    let range = |axis: usize| {
        let all = cubes.iter().map(move |cube| cube.at[axis]);
        (all.clone().min().unwrap_or(0), all.max().unwrap_or(0))
    };
    let ((west, east), (north, south)) = (range(0), range(2));
    if west.abs_diff(east).max(north.abs_diff(south)) > GROUND_SPAN {
        return Vec::new();
    }
    let columns = (west - MARGIN..=east + MARGIN).flat_map(|x| (north - MARGIN..=south + MARGIN).map(move |z| (x, z)));
    let free = columns.map(|(x, z)| [x, GROUND_Y, z]).filter(|at| !filled.contains(at));
    free.map(|at| Cube { at, colour: GROUND[(at[0] + at[2]).rem_euclid(2) as usize] }).collect()
}

/// Draws a build.
#[must_use]
pub fn svg(scene: &Scene<'_>) -> String {
    let all = scene.blocks.len();
    let cubes = scene.cubes();
    let cells: HashSet<[i32; 3]> = cubes.iter().map(|cube| cube.at).collect();
    let point = |x: i32, y: i32, z: i32| ((x - z) * HALF_WIDTH, (x + z) * QUARTER - y * HEIGHT);
    let (mut low, mut high) = ((i32::MAX, i32::MAX), (i32::MIN, i32::MIN));
    let mut faces = String::new();
    for Cube { at: [x, y, z], colour } in &cubes {
        let (x, y, z) = (*x, *y, *z);
        let is_free = |dx: i32, dy: i32, dz: i32| !cells.contains(&[x + dx, y + dy, z + dz]);
        let sides = [
            (is_free(0, 1, 0), 100, [(0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)]),
            (is_free(0, 0, 1), 80, [(0, 1, 1), (1, 1, 1), (1, 0, 1), (0, 0, 1)]),
            (is_free(1, 0, 0), 64, [(1, 1, 0), (1, 1, 1), (1, 0, 1), (1, 0, 0)]),
        ];
        for (_, light, corners) in sides.into_iter().filter(|(is_free, ..)| *is_free) {
            let [r, g, b] = colour.map(|part| u32::from(part) * light / 100);
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
    if cubes.is_empty() {
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
