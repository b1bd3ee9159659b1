//! The search for large boxes: from one region of free anchors to the next.

use std::collections::HashSet;

use super::regions::{Cuboid, Regions};
use crate::voxel::cell::Cell;

/// Number of steps between two polls of the stop signal.
const STEPS_PER_LOOK: usize = 100;

/// A place that the box reaches: a free region by its number, and the level in it if it is a shaft. In a shaft, a single
/// cell on each level, no step leads straight up or down. In any other region, each anchor is reached from each other.
type Place = (u32, Option<i16>);

struct Search {
    regions: Regions,
    seen: HashSet<Place, foldhash::fast::RandomState>,
    open: Vec<Place>,
    /// The regions of one step, kept to reuse its allocation.
    beside: Vec<u32>,
}

/// Does what [`super::FreeSpace::escapes`] does.
pub(super) fn escapes(
    solid: &[Cell],
    levels: [i32; 2],
    size: [i32; 3],
    starts: impl IntoIterator<Item = Cell>,
    is_stopped: &dyn Fn() -> bool,
) -> Option<bool> {
    let regions = Regions::new(solid, levels, size);
    let mut search = Search { regions, seen: HashSet::default(), open: Vec::new(), beside: Vec::new() };
    for (number, start) in starts.into_iter().enumerate() {
        if number.is_multiple_of(STEPS_PER_LOOK) && is_stopped() {
            return None;
        }
        let at = [start.x, start.y, start.z];
        if search.visit(&[Cuboid { min: at, max: at }]) {
            return Some(true);
        }
    }
    search.gets_out(is_stopped)
}

impl Search {
    /// Follows the queued places. Returns true once one is outside.
    fn gets_out(&mut self, is_stopped: &dyn Fn() -> bool) -> Option<bool> {
        let mut steps: usize = 0;
        while let Some(place) = self.open.pop() {
            if steps.is_multiple_of(STEPS_PER_LOOK) && is_stopped() {
                return None;
            }
            steps += 1;
            if self.steps_out(place) {
                return Some(true);
            }
        }
        Some(false)
    }

    /// Queues what one step from a place reaches. Returns true if that is outside.
    ///
    /// From a single cell, a step goes to one of its four sides, one level up, down or neither. From more cells side by side,
    /// it also reaches what lies above and below them.
    fn steps_out(&mut self, (region, level): Place) -> bool {
        let Cuboid { min: [west, bottom, north], max: [east, top, south] } = *self.regions.free(region);
        let (bottom, top) = level.map_or((bottom, top), |level| (level.into(), level.into()));
        let space = |[west, east]: [i32; 2], [north, south]: [i32; 2]| Cuboid {
            min: [west, bottom - 1, north],
            max: [east, top + 1, south],
        };
        if level.is_none() {
            self.visit(&[space([west - 1, east + 1], [north, south]), space([west, east], [north - 1, south + 1])])
        } else {
            self.visit(&[
                space([west - 1; 2], [north; 2]),
                space([west + 1; 2], [north; 2]),
                space([west; 2], [north - 1; 2]),
                space([west; 2], [north + 1; 2]),
            ])
        }
    }

    /// Queues the unseen free places that have an anchor in one of the spaces, which have the same levels. Returns true if
    /// one is outside.
    fn visit(&mut self, spaces: &[Cuboid]) -> bool {
        let all = *self.regions.space();
        let mut around = spaces.iter().copied().reduce(|a, b| a.around(&b)).expect("a step leads somewhere");
        around.min[1] = around.min[1].max(all.min[1]);
        around.max[1] = around.max[1].min(all.max[1]);
        if around.min[1] > around.max[1] {
            return false;
        }
        let is_outside =
            |one: &Cuboid| [0, 2].iter().any(|&axis| one.min[axis] <= all.min[axis] || one.max[axis] >= all.max[axis]);
        if is_outside(&around) {
            return true;
        }
        let mut beside = std::mem::take(&mut self.beside);
        self.regions.find(&around, &mut beside);
        for number in beside.drain(..) {
            let region = self.regions.free(number);
            if !spaces.iter().any(|space| space.meets(region)) {
                continue;
            }
            if is_outside(region) {
                return true;
            }
            let is_shaft = [0, 2].iter().all(|&axis| region.min[axis] == region.max[axis]);
            let (bottom, top) = (region.min[1].max(around.min[1]), region.max[1].min(around.max[1]));
            for level in if is_shaft { bottom..=top } else { bottom..=bottom } {
                let level = is_shaft.then(|| i16::try_from(level).expect("levels are between -2,048 and 2,047"));
                if self.seen.insert((number, level)) {
                    self.open.push((number, level));
                }
            }
        }
        self.beside = beside;
        false
    }
}
