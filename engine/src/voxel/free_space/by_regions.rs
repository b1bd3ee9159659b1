//! The search for large boxes: from one region of free anchors to the next.

use super::regions::{Cuboid, Regions};
use crate::voxel::cell::Cell;

/// A search. A place that the box reaches is a free region, or one level of a shaft, which is a single cell wide. In a shaft
/// no step leads straight up or down. In any other region, each anchor is reached from each other.
struct Search<'a> {
    regions: Regions<'a>,
    /// The places that were reached and not left yet.
    open: Vec<Cuboid>,
}

/// Does what [`super::FreeSpace::escapes`] does.
pub(super) fn escapes(
    solid: &[Cell],
    levels: [i32; 2],
    size: [i32; 3],
    starts: impl IntoIterator<Item = Cell>,
    is_stopped: &dyn Fn() -> bool,
) -> Option<bool> {
    let mut search = Search { regions: Regions::new(solid, levels, size, is_stopped), open: Vec::new() };
    for start in starts {
        let at = [start.x, start.y, start.z];
        if search.visit(&[Cuboid { min: at, max: at }])? {
            return Some(true);
        }
    }
    while let Some(place) = search.open.pop() {
        if search.steps_out(&place)? {
            return Some(true);
        }
    }
    Some(false)
}

impl Search<'_> {
    /// Queues what one step from a place reaches. Returns true if that is outside.
    ///
    /// From a single cell, a step goes to one of its four sides, one level up, down or neither. From more cells side by side,
    /// it also reaches what lies above and below them.
    fn steps_out(&mut self, place: &Cuboid) -> Option<bool> {
        let Cuboid { min: [west, bottom, north], max: [east, top, south] } = *place;
        let space = |[west, east]: [i32; 2], [north, south]: [i32; 2]| Cuboid {
            min: [west, bottom - 1, north],
            max: [east, top + 1, south],
        };
        if place.is_shaft() {
            self.visit(&[
                space([west - 1; 2], [north; 2]),
                space([west + 1; 2], [north; 2]),
                space([west; 2], [north - 1; 2]),
                space([west; 2], [north + 1; 2]),
            ])
        } else {
            self.visit(&[space([west - 1, east + 1], [north, south]), space([west, east], [north - 1, south + 1])])
        }
    }

    /// Queues the free places that have an anchor in one of the spaces and were not reached yet. Returns true if one is
    /// outside, and `None` if the search is to stop.
    fn visit(&mut self, spaces: &[Cuboid]) -> Option<bool> {
        let all = *self.regions.space();
        let is_outside =
            |one: &Cuboid| [0, 2].iter().any(|&axis| one.min[axis] <= all.min[axis] || one.max[axis] >= all.max[axis]);
        if spaces.iter().any(is_outside) {
            return Some(true);
        }
        let known = self.open.len();
        self.regions.take(spaces, &mut self.open)?;
        Some(self.open[known..].iter().any(is_outside))
    }
}
