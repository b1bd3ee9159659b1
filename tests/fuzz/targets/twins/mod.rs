//! Every rule a second time, as plainly as `docs/rules.md` states it: sets of cells, every pair, every chord. Slow, but
//! easy to compare with the text.

mod blocks;
mod bridges;
mod columns;
mod levels;
mod order;
mod spaces;
mod surfaces;
mod ways;
mod world;

use std::collections::BTreeSet;

use plumbline_engine::voxel::Structure;
use plumbline_engine::voxel::blocks::{BlockSet, is_structural};
use serde_json::Value;

/// A cell, as x, y and z.
pub type At = [i64; 3];
/// A place in plan, as x and z.
pub type Flat = (i64, i64);

/// An entry of a build.
#[derive(Debug, Clone)]
pub struct Block<'a> {
    pub at: At,
    pub name: &'a str,
    /// The first half of its object, if this is the second.
    pub first_half: Option<At>,
}

/// A build: its entries in building order.
pub struct Build<'a> {
    pub blocks: Vec<Block<'a>>,
    pub is_read_as_game: bool,
}

impl<'a> Build<'a> {
    pub fn of(structure: &'a Structure) -> Self {
        let cell = |cell: plumbline_engine::voxel::Cell| [cell.x, cell.y, cell.z].map(i64::from);
        let block = |i: usize| Block {
            at: cell(structure.cells()[i]),
            name: structure.material(i),
            first_half: structure.other_half(structure.cells()[i]).map(cell),
        };
        let is_read_as_game = structure.is_read_as_game();
        Self { blocks: (0..structure.len()).map(block).collect(), is_read_as_game }
    }

    /// Returns the build without what nothing can be built of, if the arguments ask for that.
    pub fn standing(&self, only_solid: bool) -> Self {
        let blocks = self.blocks.iter().filter(|block| !only_solid || is_structural(block.name)).cloned();
        Self { blocks: blocks.collect(), is_read_as_game: self.is_read_as_game }
    }

    /// Returns the cells of the blocks whose name is wanted.
    pub fn cells(&self, is_wanted: impl Fn(&str) -> bool) -> BTreeSet<At> {
        self.blocks.iter().filter(|block| is_wanted(block.name)).map(|block| block.at).collect()
    }

    pub fn all(&self) -> BTreeSet<At> {
        self.cells(|_| true)
    }

    /// Returns the least and the greatest coordinate along an axis; the build must not be empty.
    pub fn ends(&self, axis: usize) -> (i64, i64) {
        let along = || self.blocks.iter().map(|block| block.at[axis]);
        (along().min().expect("a block"), along().max().expect("a block"))
    }

    /// Returns the places of a level, in plan.
    pub fn level(&self, y: i64) -> BTreeSet<Flat> {
        self.blocks.iter().filter(|block| block.at[1] == y).map(|block| (block.at[0], block.at[2])).collect()
    }
}

/// The arguments of a check.
#[derive(Clone, Copy)]
pub struct Arguments<'a>(pub &'a Value);

impl<'a> Arguments<'a> {
    /// Returns a number, unless it is left out or null.
    pub fn number(self, name: &str) -> Option<f64> {
        self.0[name].as_f64()
    }

    /// Returns an integer, or the default where it is left out.
    pub fn integer(self, name: &str, default: i64) -> i64 {
        self.0[name].as_i64().unwrap_or(default)
    }

    pub fn flag(self, name: &str, default: bool) -> bool {
        self.0[name].as_bool().unwrap_or(default)
    }

    pub fn text(self, name: &str) -> Option<&'a str> {
        self.0[name].as_str()
    }

    /// Returns a set of blocks, unless it is left out or null.
    pub fn blocks(self, name: &str) -> Option<BlockSet> {
        serde_json::from_value(self.0[name].clone()).ok()
    }

    pub fn list(self, name: &str) -> Vec<&'a Value> {
        self.0[name].as_array().into_iter().flatten().collect()
    }
}

/// Returns the score of a check. `None` where the rule leaves it open to rounding, and for stress, which other tests
/// compute plainly.
pub fn score(name: &str, arguments: &Value, build: &Build<'_>) -> Option<f64> {
    let (room, rule) = name.split_once('.')?;
    let arguments = Arguments(arguments);
    let solid = build.standing(arguments.flag("solid", false));
    let truth = |holds: Option<bool>| holds.map(|holds| if holds { 1.0 } else { 0.0 });
    match room {
        "material" => truth(blocks::holds(rule, arguments, build)),
        "size" => truth(levels::size(rule, arguments, build)),
        "efficiency" if rule == "l1_dist" => Some(order::path(build)),
        "dependency" => truth(order::holds(rule, arguments, build)),
        "physical_plausibility" if rule == "is_ground_connected" => truth(Some(ways::is_grounded(build))),
        "shape" => truth(
            levels::clusters(rule, arguments, build)
                .or_else(|| (rule == "has_columns").then(|| columns::holds(arguments, build)))
                .or_else(|| surfaces::holds(rule, arguments, &solid))
                .or_else(|| ways::holds(rule, arguments, build))
                .or_else(|| bridges::holds(rule, arguments, &solid))
                .or_else(|| spaces::holds(rule, arguments, build)),
        ),
        _ => None,
    }
}

/// Divides places in plan into parts that touch at sides, or at sides and corners.
pub fn parts(places: &BTreeSet<Flat>, with_corners: bool) -> Vec<BTreeSet<Flat>> {
    let touch = |a: &Flat, b: &Flat| {
        let (dx, dz) = (a.0.abs_diff(b.0), a.1.abs_diff(b.1));
        if with_corners { dx <= 1 && dz <= 1 } else { dx + dz == 1 }
    };
    let mut rest = places.clone();
    let mut parts = Vec::new();
    while let Some(first) = rest.pop_first() {
        let mut part = BTreeSet::from([first]);
        while let Some(next) = rest.iter().find(|place| part.iter().any(|other| touch(place, other))).copied() {
            rest.remove(&next);
            part.insert(next);
        }
        parts.push(part);
    }
    parts
}

pub fn moved([x, y, z]: At, [dx, dy, dz]: At) -> At {
    [x + dx, y + dy, z + dz]
}

/// The four steps to the sides.
pub const SIDES: [At; 4] = [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]];
