//! Builds seen from above and from a corner, without perspective, as SVG.

use std::collections::{BTreeSet, HashSet};
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::colours::{self, Box3, Colour, Look, WHOLE};

/// Blocks that a picture on a page shows: one of more blocks is a large file and shows less.
pub const MAX_BLOCKS: usize = 30_000;
/// Sixteenths of a block on an axis: boxes inside of blocks are given in them.
const PARTS: i64 = 16;
/// Half the width of a sixteenth of a block, in SVG units.
const HALF_WIDTH: i64 = 10;
/// Vertical offset of a sixteenth on the ground, a quarter of its width, in SVG units.
const QUARTER: i64 = 5;
/// Height of a sixteenth, in SVG units.
const HEIGHT: i64 = 12;
/// Cells of ground around a build.
const MARGIN: i32 = 2;
/// Height of the uppermost layer of ground.
const GROUND_Y: i32 = -1;
/// Height of the lowest layer of ground.
const LOWEST_Y: i32 = -64;
/// Longest side of a build that is drawn with its ground, in cells.
const GROUND_SPAN: u32 = 128;
/// Colour of the ground below its uppermost layer.
const DIRT: Colour = [134, 96, 67];
/// Colours of the ground: fields of two greens make distances countable.
const GROUND: [Colour; 2] = [[122, 168, 92], [114, 158, 86]];

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

    /// Turns the boxes of a look likewise.
    fn turned_look(self, look: Look) -> Look {
        let turned = |[x, y, z, dx, dy, dz]: Box3| match self {
            Self::SouthEast => [x, y, z, dx, dy, dz],
            Self::SouthWest => [z, y, 16 - dx, dz, dy, 16 - x],
            Self::NorthWest => [16 - dx, y, 16 - dz, 16 - x, dy, 16 - z],
            Self::NorthEast => [16 - dz, y, x, 16 - z, dy, dx],
        };
        let mut boxes: Vec<Box3> = look.boxes.into_iter().map(turned).collect();
        // Farthest first, as cells are.
        boxes.sort_by_key(|[x, y, z, ..]| (u16::from(*x) + u16::from(*y) + u16::from(*z), *y));
        Look { boxes, ..look }
    }
}

/// What to draw.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    /// Blocks, by their names without states.
    pub blocks: Vec<([i32; 3], &'a str)>,
    /// Cells of the ground that were dug out.
    pub dug: Vec<[i32; 3]>,
    /// Greatest number of blocks that are drawn; those that whole blocks hide do not count.
    pub most: usize,
    /// Corner from which they are seen.
    pub corner: Corner,
    /// Whether the ground around the build is drawn.
    pub has_ground: bool,
}

/// A cell to draw.
struct Cube {
    at: [i32; 3],
    look: Look,
}

impl Scene<'_> {
    /// Returns the cells to draw, from the farthest to the nearest, so that nearer ones cover those behind them, and
    /// the number of blocks that could be seen but are left out.
    fn cubes(&self) -> (Vec<Cube>, usize) {
        // Near the origin all numbers are exact, also in programs that read the picture.
        let [west, _, north] = self.least();
        let moved = |[x, y, z]: [i32; 3]| self.corner.turned([x - west, y, z - north]);
        let all: Vec<Cube> = self
            .blocks
            .iter()
            .map(|(at, name)| Cube { at: moved(*at), look: self.corner.turned_look(colours::look(name)) })
            .collect();
        let whole: HashSet<[i32; 3]> =
            all.iter().filter(|cube| cube.look.boxes.is_empty()).map(|cube| cube.at).collect();
        let is_seen = |cube: &Cube| {
            let [x, y, z] = cube.at;
            ![[x, y + 1, z], [x, y, z + 1], [x + 1, y, z]].iter().all(|near| whole.contains(near))
        };
        let ground = if self.has_ground {
            ground_around(&all, &self.dug.iter().map(|at| moved(*at)).collect())
        } else {
            Vec::new()
        };
        let mut cubes: Vec<Cube> = all.into_iter().filter(is_seen).collect();
        let left_out = cubes.len().saturating_sub(self.most);
        cubes.truncate(self.most);
        cubes.extend(ground);
        cubes.sort_by_key(|Cube { at: [x, y, z], .. }| (x + y + z, *y, *x));
        (cubes, left_out)
    }

    /// Returns the least coordinate on each axis.
    fn least(&self) -> [i32; 3] {
        let mut cells = self.blocks.iter().map(|(at, _)| *at).chain(self.dug.iter().copied());
        let first = cells.next().unwrap_or_default();
        cells.fold(first, |least, at| std::array::from_fn(|axis| least[axis].min(at[axis])))
    }
}

/// Returns the cells of natural ground below and around some cells, without those that were dug out. Where the
/// uppermost layer was dug out, the one below shows.
fn ground_around(cubes: &[Cube], dug: &HashSet<[i32; 3]>) -> Vec<Cube> {
    let filled: HashSet<[i32; 3]> = cubes.iter().map(|cube| cube.at).collect();
    let range = |axis: usize| {
        let all = cubes.iter().map(move |cube| cube.at[axis]).chain(dug.iter().map(move |at| at[axis]));
        (all.clone().min().unwrap_or(0), all.max().unwrap_or(0))
    };
    let ((west, east), (north, south)) = (range(0), range(2));
    if west.abs_diff(east).max(north.abs_diff(south)) > GROUND_SPAN {
        return Vec::new();
    }
    let columns = (west - MARGIN..=east + MARGIN).flat_map(|x| (north - MARGIN..=south + MARGIN).map(move |z| (x, z)));
    let mut ground = Vec::new();
    for (x, z) in columns {
        // A pit shows its floor: the first natural cell below what was dug out.
        let floor = (LOWEST_Y..=GROUND_Y).rev().map(|y| [x, y, z]).find(|at| !dug.contains(at));
        let Some(at) = floor.filter(|at| !filled.contains(at)) else { continue };
        let colour = if at[1] == GROUND_Y { GROUND[(x + z).rem_euclid(2) as usize] } else { DIRT };
        ground.push(Cube { at, look: Look { top: colour, side: colour, boxes: Vec::new() } });
    }
    // The walls of pits that the viewer looks at.
    let walls: BTreeSet<[i32; 3]> = dug.iter().flat_map(|[x, y, z]| [[x - 1, *y, *z], [*x, *y, z - 1]]).collect();
    let is_wall = |at: &[i32; 3]| at[1] < GROUND_Y && !dug.contains(at) && !filled.contains(at);
    let drawn: HashSet<[i32; 3]> = ground.iter().map(|cube| cube.at).collect();
    let wall = |at| Cube { at, look: Look { top: DIRT, side: DIRT, boxes: Vec::new() } };
    ground.extend(walls.into_iter().filter(|at| is_wall(at) && !drawn.contains(at)).map(wall));
    ground
}

/// Draws a build.
#[must_use]
pub fn svg(scene: &Scene<'_>) -> String {
    let (cubes, left_out) = scene.cubes();
    // Only whole blocks hide what is behind them.
    let whole = cubes.iter().filter(|cube| cube.look.boxes.is_empty());
    let whole: HashSet<[i32; 3]> = whole.map(|cube| cube.at).collect();
    let mut drawing = Drawing::default();
    for Cube { at: [x, y, z], look } in &cubes {
        let is_free = |dx: i32, dy: i32, dz: i32| !whole.contains(&[x + dx, y + dy, z + dz]);
        let shown = [is_free(0, 1, 0), is_free(0, 0, 1), is_free(1, 0, 0)];
        let boxes = if look.boxes.is_empty() { &[WHOLE][..] } else { &look.boxes };
        for part in boxes {
            drawing.add([*x, *y, *z], *part, look, shown);
        }
    }
    let Drawing { mut faces, mut low, mut high } = drawing;
    if cubes.is_empty() {
        (low, high) = ((0, 0), (1280, 960));
        faces.push_str(
            "<text x=\"640\" y=\"544\" text-anchor=\"middle\" font-size=\"144\" fill=\"#888\">no blocks</text>",
        );
    }
    let (width, height) = (high.0 - low.0, high.1 - low.1);
    let note = if left_out > 0 { format!("<title>without {left_out} more blocks</title>") } else { String::new() };
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{} {} {} {}\" stroke=\"#0003\" stroke-width=\"10\" \
         stroke-linejoin=\"round\">{note}{faces}</svg>",
        low.0 - 64,
        low.1 - 64,
        width + 128,
        height + 128
    )
}

/// Faces drawn so far, and the corners of what they cover.
struct Drawing {
    faces: String,
    low: (i64, i64),
    high: (i64, i64),
}

impl Default for Drawing {
    fn default() -> Self {
        Self { faces: String::new(), low: (i64::MAX, i64::MAX), high: (i64::MIN, i64::MIN) }
    }
}

impl Drawing {
    /// Draws a box in a cell: its top, and the sides towards the south and the east. `shown` says for each whether it
    /// can be seen where it is at the side of the cell.
    fn add(&mut self, at: [i32; 3], [x, y, z, dx, dy, dz]: Box3, look: &Look, shown: [bool; 3]) {
        let is_shown = [shown[0] || dy < 16, shown[1] || dz < 16, shown[2] || dx < 16];
        let sides = [
            (look.top, 100, [(x, dy, z), (dx, dy, z), (dx, dy, dz), (x, dy, dz)]),
            (look.side, 80, [(x, dy, dz), (dx, dy, dz), (dx, y, dz), (x, y, dz)]),
            (look.side, 64, [(dx, dy, z), (dx, dy, dz), (dx, y, dz), (dx, y, z)]),
        ];
        let cell = at.map(|part| i64::from(part) * PARTS);
        for ((colour, light, corners), _) in sides.into_iter().zip(is_shown).filter(|(_, is_shown)| *is_shown) {
            let [r, g, b] = colour.map(|part| u32::from(part) * light / 100);
            let _ = write!(self.faces, "<path fill=\"#{r:02x}{g:02x}{b:02x}\" d=\"M");
            for (x, y, z) in corners {
                let [x, y, z] = [cell[0] + i64::from(x), cell[1] + i64::from(y), cell[2] + i64::from(z)];
                let (px, py) = ((x - z) * HALF_WIDTH, (x + z) * QUARTER - y * HEIGHT);
                self.low = (self.low.0.min(px), self.low.1.min(py));
                self.high = (self.high.0.max(px), self.high.1.max(py));
                let _ = write!(self.faces, "{px} {py} ");
            }
            self.faces.push_str("z\"/>");
        }
    }
}
