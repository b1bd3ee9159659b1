//! The world of a walker, cell by cell: what is solid, what is air, where one stands, and what lies enclosed.

use std::collections::{BTreeMap, BTreeSet};

use plumbline_engine::voxel::blocks::{is_climbable, is_door, is_passable, is_thin};

use super::{At, Build, Flat, SIDES, moved};

/// Greatest extent of a build along an axis.
const MAX: i64 = 128;

pub struct World {
    solid: BTreeSet<At>,
    ladders: BTreeSet<At>,
    /// The lower halves.
    pub doors: Vec<At>,
    /// Both halves.
    doorways: BTreeSet<At>,
    /// The ends of the build along x and z, and the greatest height that matters.
    x: (i64, i64),
    z: (i64, i64),
    top: i64,
    /// For each cell of air the first cell of its region; the outside has that of the least one of all.
    region: BTreeMap<At, At>,
}

impl World {
    /// Returns `None` for a build that is empty or too large.
    pub fn of(build: &Build<'_>) -> Option<Self> {
        if build.blocks.is_empty() {
            return None;
        }
        let ends = [0, 1, 2].map(|axis| build.ends(axis));
        if ends.iter().any(|(least, most)| most - least >= MAX) || ends[1].1 >= MAX {
            return None;
        }
        let is_game = build.is_read_as_game;
        let is_ladder = |name: &str| is_game && is_climbable(name);
        let is_open = |name: &str| is_passable(name) || is_ladder(name) || is_game && is_thin(name);
        let solid: BTreeSet<At> =
            build.cells(|name| !is_door(name) && !is_open(name)).into_iter().filter(|at| at[1] >= 0).collect();
        let own = build.blocks.iter().filter(|block| block.at[1] >= 0 && is_door(block.name));
        let doors: Vec<At> = own.filter(|door| door.first_half.is_none()).map(|door| door.at).collect();
        let halves = doors.iter().flat_map(|door| [*door, moved(*door, [0, 1, 0])]);
        let doorways = halves.filter(|half| !solid.contains(half)).collect();
        let ladders = build.cells(is_ladder);
        let (x, z, top) = (ends[0], ends[2], ends[1].1.max(0) + 3);
        let mut world = Self { solid, ladders, doors, doorways, x, z, top, region: BTreeMap::new() };
        let (x, z) = (x.0 - 2..=x.1 + 2, z.0 - 2..=z.1 + 2);
        let mut cells =
            (0..=top).flat_map(|y| x.clone().map(move |x| (x, y))).flat_map(|(x, y)| z.clone().map(move |z| [x, y, z]));
        while let Some(first) = cells.find(|at| world.is_air(*at) && !world.region.contains_key(at)) {
            let mut open = vec![first];
            while let Some(at) = open.pop() {
                if world.is_air(at) && !world.region.contains_key(&at) {
                    world.region.insert(at, first);
                    open.extend((-1..=1).flat_map(|dx| (-1..=1).map(move |dz| moved(at, [dx, 0, dz]))));
                    open.extend([1, -1].map(|dy| moved(at, [0, dy, 0])));
                }
            }
        }
        Some(world)
    }

    fn is_in_grid(&self, [x, y, z]: At) -> bool {
        (0..=self.top).contains(&y)
            && (self.x.0 - 2..=self.x.1 + 2).contains(&x)
            && (self.z.0 - 2..=self.z.1 + 2).contains(&z)
    }

    /// Air that is no doorway, near the build.
    fn is_air(&self, at: At) -> bool {
        self.is_in_grid(at) && !self.solid.contains(&at) && !self.doorways.contains(&at)
    }

    fn is_solid(&self, at: At) -> bool {
        at[1] < 0 || self.solid.contains(&at)
    }

    pub fn can_stand(&self, feet: At) -> bool {
        let below = moved(feet, [0, -1, 0]);
        let holds =
            self.is_solid(below) || self.ladders.contains(&feet) || below[1] >= 0 && self.ladders.contains(&below);
        self.is_in_grid(feet) && holds && !self.is_solid(feet) && !self.is_solid(moved(feet, [0, 1, 0]))
    }

    pub fn is_floor(&self, feet: At) -> bool {
        self.can_stand(feet) && self.is_solid(moved(feet, [0, -1, 0])) && !self.ladders.contains(&feet)
    }

    pub fn is_enclosed(&self, at: At) -> bool {
        self.region.get(&at).is_some_and(|region| *region != self.outside())
    }

    /// The cell by which the outside is known: it lies in the margin.
    fn outside(&self) -> At {
        [self.x.0 - 2, 0, self.z.0 - 2]
    }

    /// Returns the regions on two opposite sides of a door through which one can walk.
    pub fn joined_by(&self, door: At) -> Option<[At; 2]> {
        let region = |at: At| self.region.get(&at).copied().filter(|_| self.can_stand(at));
        let through = |[x, y, z]: At| Some([region(moved(door, [-x, -y, -z]))?, region(moved(door, [x, y, z]))?]);
        through([1, 0, 0]).or_else(|| through([0, 0, 1])).filter(|_| self.can_stand(door))
    }

    /// Returns the enclosed regions, each with its cells.
    pub fn enclosed(&self) -> BTreeMap<At, BTreeSet<At>> {
        let mut regions: BTreeMap<At, BTreeSet<At>> = BTreeMap::new();
        for (at, region) in self.region.iter().filter(|(_, region)| **region != self.outside()) {
            regions.entry(*region).or_default().insert(*at);
        }
        regions
    }

    /// Returns the share of doors in what stands beside the air of a region.
    pub fn door_share(&self, cells: &BTreeSet<At>) -> f64 {
        let beside = cells.iter().flat_map(|at| SIDES.map(|side| moved(*at, side)));
        let sides: BTreeSet<At> = beside.filter(|at| !self.is_air(*at)).collect();
        let doors = sides.iter().filter(|at| self.doorways.contains(*at)).count();
        if sides.is_empty() { 0.0 } else { doors as f64 / sides.len() as f64 }
    }

    pub fn floors(&self, cells: &BTreeSet<At>) -> usize {
        cells.iter().filter(|at| self.is_floor(**at)).count()
    }

    /// Returns the cells of each enclosed region with so many cells of floor that doors lead to from outside.
    pub fn rooms(&self, least: usize) -> Vec<BTreeSet<At>> {
        let joints: Vec<[At; 2]> = self.doors.iter().filter_map(|door| self.joined_by(*door)).collect();
        let mut entered = BTreeSet::from([self.outside()]);
        for _ in 0..=joints.len() {
            let beyond = joints.iter().filter(|joint| joint.iter().any(|end| entered.contains(end))).flatten();
            let beyond: Vec<At> = beyond.copied().collect();
            entered.extend(beyond);
        }
        let enclosed = self.enclosed().into_iter().filter(|(region, _)| entered.contains(region));
        enclosed.map(|(_, cells)| cells).filter(|cells| self.floors(cells) >= least).collect()
    }

    /// Returns where a walker of `width` by `width` cells gets to from the ground around the build, in steps of at most
    /// `step`; it is known by its cell of least x and z.
    pub fn walked(&self, step: i64, width: i64) -> BTreeSet<At> {
        let square = |at: At| (0..width).flat_map(move |dx| (0..width).map(move |dz| moved(at, [dx, 0, dz])));
        let fits = |at: &At| square(*at).all(|cell| self.can_stand(cell));
        let is_outside = |(x, z): Flat| x < self.x.0 || x > self.x.1 || z < self.z.0 || z > self.z.1;
        let ground = (self.x.0 - 2..=self.x.1 + 2).flat_map(|x| (self.z.0 - 2..=self.z.1 + 2).map(move |z| [x, 0, z]));
        let is_start = |at: &At| square(*at).all(|cell| is_outside((cell[0], cell[2]))) && fits(at);
        let mut open: Vec<At> = ground.filter(is_start).collect();
        let mut walked = BTreeSet::new();
        while let Some(at) = open.pop() {
            if !walked.insert(at) {
                continue;
            }
            for side in SIDES.map(|side| moved(at, side)) {
                for to in (-step..=step).map(|dy| moved(side, [0, dy, 0])) {
                    // The lower of the two cells has room for who stands one higher.
                    let low = if to[1] < at[1] { to } else { at };
                    let has_room = to[1] == at[1] || !self.is_solid(moved(low, [0, 2, 0]));
                    open.extend(Some(to).filter(|to| has_room && fits(to)));
                }
            }
            let (up, down) = (moved(at, [0, 1, 0]), moved(at, [0, -1, 0]));
            open.extend(Some(up).filter(|up| step > 0 && self.ladders.contains(&at) && fits(up)));
            open.extend(Some(down).filter(|down| step > 0 && self.ladders.contains(down) && fits(down)));
        }
        walked
    }

    pub fn ceiling(&self, feet: At) -> Option<i64> {
        (feet[1] + 1..=self.top).find(|y| self.solid.contains(&[feet[0], *y, feet[2]]))
    }
}
