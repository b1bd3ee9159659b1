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
            let of_size = world.enclosed().values().filter(|cells| world.floors(cells) >= least).count() as f64;
            world.rooms(least).len() as f64 >= number("min_rooms", 0.0)
                && arguments.number("max_rooms").is_none_or(|most| of_size <= most)
        }),
        "doors_lead_through" => in_world(&|world| {
            world.doors.len() as f64 >= number("min_doors", 1.0)
                && world.doors.iter().all(|door| world.joined_by(*door).is_some())
        }),
        "walks_out" => in_world(&|world| walks_out(arguments, build, world)),
        "climbs_to" => in_world(&|world| {
            let highest = world.walked(1, 1).iter().map(|feet| feet[1] - 1).max();
            highest.is_some_and(|y| y as f64 >= number("min_y", f64::INFINITY))
        }),
        "has_upper_floor" => in_world(&|world| {
            let is_upper = |feet: &&At| {
                (feet[1] - 1) as f64 >= number("min_y", f64::INFINITY)
                    && world.is_floor(**feet)
                    && world.is_enclosed(**feet)
            };
            world.walked(1, 1).iter().filter(is_upper).count() as f64 >= number("min_cells", 4.0)
        }),
        "has_ceilings" => in_world(&|world| {
            let mut over: BTreeMap<i64, f64> = BTreeMap::new();
            for feet in world.rooms(4).iter().flatten().filter(|at| world.is_floor(**at)) {
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
        beside.filter(|side| world.is_enclosed(*side)).any(|side| square(side).any(|at| walked.contains(&at)))
    };
    starts.len() as f64 >= arguments.number("min_starts").unwrap_or(1.0) && starts.iter().all(gets_out)
}
