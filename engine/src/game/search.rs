//! Searches for the nearest blocks of some kinds.

use std::collections::{BTreeMap, BTreeSet};

use super::coordinates::{MAX_Y, MIN_Y};
use super::registry::{AIR, Block, StateId};
use super::world::World;
use crate::voxel::cell::Cell;

/// Greatest distance of a search, in blocks.
pub const MAX_DISTANCE: f64 = 128.0;
/// Greatest number of blocks that a search finds.
pub const MAX_FOUND: usize = 100_000;

impl World {
    /// Finds the nearest blocks of some kinds, given as numbers of blocks: at most `count` within `distance`, nearest
    /// first. Both have a limit, because a search is work that nobody can interrupt.
    #[must_use]
    pub fn find(&self, from: Cell, distance: f64, count: usize, kinds: &[u16]) -> Vec<Cell> {
        let (distance, count) = (distance.clamp(0.0, MAX_DISTANCE), count.min(MAX_FOUND));
        let most = (distance * distance) as i64;
        let wanted: BTreeSet<u16> = kinds.iter().copied().collect();
        let mut found: Vec<(i64, Cell)> = Vec::new();
        if natural_kinds().iter().any(|kind| wanted.contains(kind)) {
            // Nature is everywhere, so the nearest ones are near: shell by shell. Those of a shell are at least as far
            // away as its radius.
            let mut settled = 0;
            for radius in 0..=distance as i32 {
                if settled >= count {
                    break;
                }
                let of_shell = shell(from, radius).filter(|cell| wanted.contains(&self.state(*cell).block().number));
                found.extend(of_shell.map(|cell| (squared(from, cell), cell)).filter(|(at, _)| *at <= most));
                if found.len() >= count {
                    let seen = i64::from(radius) * i64::from(radius);
                    settled = found.iter().filter(|(at, _)| *at <= seen).count();
                }
            }
        } else {
            let built = self.built().filter(|(_, look)| wanted.contains(&look.state.block().number));
            found.extend(built.map(|(cell, _)| (squared(from, cell), cell)).filter(|(at, _)| *at <= most));
        }
        found.sort_unstable_by_key(|(at, cell)| (*at, cell.x, cell.y, cell.z));
        found.truncate(count);
        found.into_iter().map(|(_, cell)| cell).collect()
    }

    /// Returns all states that are in the world.
    #[must_use]
    pub fn states(&self) -> BTreeSet<StateId> {
        let natural = natural_kinds().map(|kind| Block::numbered(kind).expect("a kind of block").default);
        self.built().map(|(_, look)| look.state).chain(natural).collect()
    }

    /// Returns the numbers of the kinds of blocks within a distance, but air, nearest first.
    #[must_use]
    pub fn kinds_within(&self, from: Cell, distance: f64) -> Vec<u16> {
        let mut nearest: BTreeMap<u16, i64> = BTreeMap::new();
        let natural = natural_kinds().into_iter().filter(|kind| *kind != AIR.block().number);
        let natural = natural.filter_map(|kind| self.find(from, distance, 1, &[kind]).first().copied());
        for cell in natural.chain(self.built().map(|(cell, _)| cell)) {
            let at = squared(from, cell);
            let state = self.state(cell);
            if !state.is_air() && at as f64 <= distance * distance {
                let before = nearest.entry(state.block().number).or_insert(at);
                *before = at.min(*before);
            }
        }
        let mut kinds: Vec<(i64, u16)> = nearest.into_iter().map(|(kind, at)| (at, kind)).collect();
        kinds.sort_unstable();
        kinds.into_iter().map(|(_, kind)| kind).collect()
    }

    /// Returns the height of the uppermost block of a column, if it has one.
    #[must_use]
    pub fn surface(&self, x: i32, z: i32) -> Option<i32> {
        (MIN_Y..=MAX_Y).rev().find(|y| !self.state(Cell::new(x, *y, z)).is_air())
    }
}

fn squared(from: Cell, to: Cell) -> i64 {
    [to.x - from.x, to.y - from.y, to.z - from.z].iter().map(|d| i64::from(*d) * i64::from(*d)).sum()
}

/// Numbers of the blocks that are there without being built.
fn natural_kinds() -> [u16; 3] {
    let number = |name| Block::named(name).expect("the game has the block").number;
    [AIR.block().number, number("grass_block"), number("dirt")]
}

/// Returns the cells of the world whose greatest distance along an axis is `radius`.
fn shell(from: Cell, radius: i32) -> impl Iterator<Item = Cell> {
    let span = move |is_whole: bool| -> Box<dyn Iterator<Item = i32>> {
        if is_whole || radius == 0 { Box::new(-radius..=radius) } else { Box::new([-radius, radius].into_iter()) }
    };
    (-radius..=radius).filter(move |dy| (MIN_Y..=MAX_Y).contains(&(from.y + dy))).flat_map(move |dy| {
        (-radius..=radius).flat_map(move |dz| {
            let is_face = dy.abs() == radius || dz.abs() == radius;
            span(is_face).map(move |dx| from.offset(dx, dy, dz))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::game::world::GROUND_Y;

    fn number(name: &str) -> u16 {
        Block::named(name).unwrap().number
    }

    #[test]
    fn the_nearest_come_first_whether_they_were_built_or_not() {
        let mut world = World::default();
        for command in ["setblock 5 0 0 stone", "setblock 2 0 0 stone", "setblock 40 0 0 stone"] {
            world.command(command).unwrap();
        }
        let origin = Cell::new(0, 0, 0);
        let stone = [number("stone")];
        assert_eq!(world.find(origin, 16.0, 10, &stone), [Cell::new(2, 0, 0), Cell::new(5, 0, 0)]);
        assert_eq!(world.find(origin, 64.0, 1, &stone), [Cell::new(2, 0, 0)]);
        assert_eq!(world.find(origin, 16.0, 1, &[number("grass_block")]), [Cell::new(0, GROUND_Y, 0)]);
        assert_eq!(world.find(origin, 1.0, 100, &[number("air")]).len(), 6);
        assert!(world.find(origin, 64.0, 5, &[number("glass")]).is_empty());
        assert_eq!((world.surface(2, 0), world.surface(3, 0)), (Some(0), Some(GROUND_Y)));
    }
}
