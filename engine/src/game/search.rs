//! Searches for the nearest blocks of some kinds.

use super::coordinates::{MAX_Y, MIN_Y};
use super::registry::{AIR, Block};
use super::world::World;
use crate::voxel::cell::Cell;

/// Greatest distance of a search, in blocks.
const MAX_DISTANCE: f64 = 256.0;

impl World {
    /// Finds the nearest blocks of some kinds, given as numbers of blocks: at most `count` within `distance`, nearest first.
    #[must_use]
    pub fn find(&self, from: Cell, distance: f64, count: usize, kinds: &[u16]) -> Vec<Cell> {
        let distance = distance.clamp(0.0, MAX_DISTANCE);
        let is_wanted = |cell: Cell| kinds.contains(&self.state(cell).block().number);
        let squared = |cell: Cell| {
            [cell.x - from.x, cell.y - from.y, cell.z - from.z]
                .iter()
                .map(|d| i64::from(*d) * i64::from(*d))
                .sum::<i64>()
        };
        let most = (distance * distance) as i64;
        let mut found: Vec<(i64, Cell)> = Vec::new();
        if kinds.iter().any(|kind| natural_kinds().contains(kind)) {
            // Nature is everywhere, so the nearest ones are near: shell by shell.
            for radius in 0..=distance as i32 {
                found.extend(shell(from, radius).filter(|cell| is_wanted(*cell)).map(|cell| (squared(cell), cell)));
                // Everything within this radius has been seen.
                let seen = i64::from(radius) * i64::from(radius);
                if found.iter().filter(|(at, _)| *at <= seen).count() >= count {
                    break;
                }
            }
        } else {
            found.extend(
                self.built().map(|(cell, _)| cell).filter(|cell| is_wanted(*cell)).map(|cell| (squared(cell), cell)),
            );
        }
        found.retain(|(at, _)| *at <= most);
        found.sort_unstable_by_key(|(at, cell)| (*at, cell.y, cell.z, cell.x));
        found.truncate(count);
        found.into_iter().map(|(_, cell)| cell).collect()
    }

    /// Returns the numbers of all kinds of blocks that are in the world.
    #[must_use]
    pub fn kinds(&self) -> Vec<u16> {
        let mut kinds: Vec<u16> = self.built().map(|(_, look)| look.state.block().number).collect();
        kinds.extend(natural_kinds());
        kinds.sort_unstable();
        kinds.dedup();
        kinds
    }

    /// Returns the height of the uppermost block of a column, if it has one.
    #[must_use]
    pub fn surface(&self, x: i32, z: i32) -> Option<i32> {
        (MIN_Y..=MAX_Y).rev().find(|y| !self.state(Cell::new(x, *y, z)).is_air())
    }
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
