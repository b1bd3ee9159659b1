//! Rooms and walks: the published count of rooms on one level, and the strict rules.

use std::collections::{BTreeMap, BTreeSet};

use super::world::World;
use super::{Arguments, At, Build, Flat, SIDES, moved, parts};

pub fn holds(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    if rule == "has_rooms" {
        return Some(has_rooms(arguments, build));
    }
    let number = |name: &str, default: f64| arguments.number(name).unwrap_or(default);
    let world = World::of(build);
    let in_world = |holds: &dyn Fn(&World) -> bool| Some(world.as_ref().is_some_and(holds));
    match rule {
        "has_enclosed_rooms" => in_world(&|world| {
            let least = number("min_floor_cells", 4.0) as usize;
            let counted = number("counted_from", least as f64) as usize;
            let of_size = world.enclosed().values().filter(|cells| world.floors(cells) >= counted).count() as f64;
            let most = number("max_door_share", f64::INFINITY);
            let rooms = reached(arguments, world, least).into_iter().filter(|room| world.door_share(room) <= most);
            rooms.count() as f64 >= number("min_rooms", 0.0)
                && arguments.number("max_rooms").is_none_or(|most| of_size <= most)
        }),
        "doors_lead_through" => in_world(&|world| {
            let parts = |door: &&At| world.joined_by(**door).is_some_and(|[one, other]| one != other);
            world.doors.len() as f64 >= number("min_doors", 1.0)
                && world.doors.iter().filter(parts).count() as f64 >= number("min_parting", 0.0)
                && world.doors.iter().all(|door| world.joined_by(*door).is_some())
        }),
        "walks_out" => in_world(&|world| walks_out(arguments, build, world)),
        "climbs_to" => in_world(&|world| {
            let plan = floor_plan(build, arguments.integer("min_y", 0));
            let is_over = |feet: &&At| {
                let is_within =
                    |[x0, x1, z0, z1]: &[i64; 4]| (*x0..=*x1).contains(&feet[0]) && (*z0..=*z1).contains(&feet[2]);
                !arguments.flag("onto_floor", false) || plan.as_ref().is_some_and(is_within)
            };
            let highest = world.walked(1, 1).iter().filter(is_over).map(|feet| feet[1] - 1).max();
            highest.is_some_and(|y| y as f64 >= number("min_y", f64::INFINITY))
        }),
        "has_upper_floor" => in_world(&|world| {
            let mut walked = world.walked(1, 1);
            walked.retain(|feet| world.is_floor(*feet) && world.is_enclosed(*feet));
            let is_upper = |feet: &&At| (feet[1] - 1) as f64 >= number("min_y", f64::INFINITY);
            walked.iter().filter(is_upper).count() as f64 >= number("min_cells", 4.0)
                && walked.iter().filter(|feet| feet[1] <= 1).count() as f64 >= number("ground_cells", 0.0)
        }),
        "has_ceilings" => in_world(&|world| {
            let mut over: BTreeMap<i64, f64> = BTreeMap::new();
            for feet in reached(arguments, world, 4).iter().flatten().filter(|at| world.is_floor(**at)) {
                if let Some(y) = world.ceiling(*feet) {
                    *over.entry(y).or_default() += 1.0;
                }
            }
            over.retain(|_, cells| *cells >= number("min_cells", 4.0));
            over.len() as f64 >= number("min_levels", 1.0)
                && arguments.number("min_top").is_none_or(|top| over.keys().any(|y| *y as f64 >= top))
        }),
        _ => None,
    }
}

/// Returns the rooms to a floor of which one can walk from outside, or all where no step is given.
fn reached(arguments: Arguments<'_>, world: &World, least: usize) -> Vec<BTreeSet<At>> {
    let mut rooms = world.rooms(least);
    if let Some(step) = arguments.number("max_step") {
        let walked = world.walked((step as i64).min(1), 1);
        rooms.retain(|room| room.iter().any(|at| walked.contains(at) && world.is_floor(*at)));
    }
    rooms
}

/// Returns the ends along x and z of the part of a level with the largest rectangle around it; the first of equal ones.
fn floor_plan(build: &Build<'_>, y: i64) -> Option<[i64; 4]> {
    let mut best: Option<[i64; 4]> = None;
    let area = |[x0, x1, z0, z1]: &[i64; 4]| (x1 - x0 + 1) * (z1 - z0 + 1);
    for part in parts(&build.level(y), true) {
        let x = part.iter().map(|at| at.0);
        let z = part.iter().map(|at| at.1);
        let own = [x.clone().min()?, x.max()?, z.clone().min()?, z.max()?];
        best = Some(best.filter(|best| area(best) >= area(&own)).unwrap_or(own));
    }
    best
}

fn has_rooms(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    let wanted = arguments.number("room_cnt").unwrap_or(0.0);
    let y = arguments.integer("y", 2);
    let is_wall = |block: &&super::Block<'_>| {
        block.at[1] == y || block.at[1] == y - 1 && block.name.to_lowercase().contains("door")
    };
    let walls: BTreeSet<Flat> = build.blocks.iter().filter(is_wall).map(|block| (block.at[0], block.at[2])).collect();
    let ends = |along: fn(&Flat) -> i64| walls.iter().map(along).min().zip(walls.iter().map(along).max());
    let (Some(x), Some(z)) = (ends(|at| at.0), ends(|at| at.1)) else { return wanted <= 0.0 };
    let air =
        (x.0 - 1..=x.1 + 1).flat_map(|x| (z.0 - 1..=z.1 + 1).map(move |z| (x, z))).filter(|at| !walls.contains(at));
    // One of the pieces of air is the outside.
    wanted <= 0.0 || parts(&air.collect(), true).len() as f64 - 1.0 >= wanted
}

fn walks_out(arguments: Arguments<'_>, build: &Build<'_>, world: &World) -> bool {
    let Some(from) = arguments.blocks("from") else { return false };
    let (step, width) = (arguments.integer("max_step", 1).min(1), arguments.integer("width", 1).clamp(1, 2));
    let walked = world.walked(step, width);
    let square = |at: At| (0..width).flat_map(move |dx| (0..width).map(move |dz| moved(at, [-dx, 0, -dz])));
    // An object counts once, and its paths may begin beside each of its halves.
    let mut starts: Vec<Vec<At>> = Vec::new();
    for block in build.blocks.iter().filter(|block| from.has(block.name)) {
        if block.first_half.is_none() {
            let own = build.blocks.iter().filter(|other| other.first_half == Some(block.at) && from.has(other.name));
            starts.push(own.map(|half| half.at).chain([block.at]).collect());
        }
    }
    let gets_out = |start: &Vec<At>| {
        let beside = start.iter().flat_map(|at| SIDES.iter().map(|side| moved(*at, *side)));
        let is_inside = start.iter().any(|at| world.is_enclosed(moved(*at, [0, 1, 0])));
        let gets_out =
            beside.filter(|side| world.is_enclosed(*side)).any(|side| square(side).any(|at| walked.contains(&at)));
        gets_out && (is_inside || !arguments.flag("indoors", false))
    };
    starts.len() as f64 >= arguments.number("min_starts").unwrap_or(1.0) && starts.iter().all(gets_out)
}
