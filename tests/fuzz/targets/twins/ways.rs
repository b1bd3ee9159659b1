//! Ground, doors, stairs and ways out, as published.

use std::collections::BTreeSet;

use super::{Arguments, At, Build, Flat, SIDES, moved};

pub fn holds(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    let side = |name: &str, default: i64| arguments.integer(name, default);
    match rule {
        "are_doors_passable" => Some(are_doors_passable(build)),
        "are_adjacent" => Some(are_adjacent(arguments, build)),
        "is_reachable_by_stairs" => Some(
            highest_by_stairs(build)
                .is_some_and(|y| y as f64 >= arguments.number("min_floor_y").unwrap_or(f64::INFINITY)),
        ),
        "is_single_level" => Some(is_single_level(arguments, build)),
        "has_exit" => Some(has_exit(arguments, build, [side("width", 2), side("height", 2), side("depth", 1)])),
        "has_wide_exit" => Some(has_exit(arguments, build, [side("width", 2), 2, side("width", 2)])),
        _ => None,
    }
}

const FACES: [At; 6] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

fn is_door(name: &str) -> bool {
    name.to_lowercase().contains("door")
}

/// Takes all that can be reached from `open` by `next`.
fn reached(open: impl IntoIterator<Item = At>, next: impl Fn(At) -> Vec<At>) -> BTreeSet<At> {
    let mut open: Vec<At> = open.into_iter().collect();
    let mut reached = BTreeSet::new();
    while let Some(at) = open.pop() {
        if reached.insert(at) {
            open.extend(next(at));
        }
    }
    reached
}

pub fn is_grounded(build: &Build<'_>) -> bool {
    let cells = build.all();
    let on_ground = cells.iter().copied().filter(|at| at[1] <= 0);
    let beside = |at: At| FACES.iter().map(|face| moved(at, *face)).filter(|at| cells.contains(at)).collect();
    reached(on_ground, beside) == cells
}

fn are_doors_passable(build: &Build<'_>) -> bool {
    let solid = build.cells(|name| !is_door(name));
    let mut columns = BTreeSet::new();
    build.blocks.iter().filter(|block| is_door(block.name)).all(|door| {
        let is_free = |dy: i64| {
            let sides = SIDES.iter().map(|side| moved(door.at, moved(*side, [0, dy, 0])));
            sides.filter(|side| solid.contains(side)).count() < 3
        };
        !columns.insert((door.at[0], door.at[2])) || is_free(0) && is_free(1)
    })
}

fn are_adjacent(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    let names: Vec<String> =
        arguments.list("materials").into_iter().filter_map(serde_json::Value::as_str).map(str::to_lowercase).collect();
    let [one, other] = &names[..] else { return false };
    let cells = |wanted: &str| {
        build.cells(|name| {
            let name = name.to_lowercase();
            if arguments.flag("substring_match", true) { name.contains(wanted) } else { name == wanted }
        })
    };
    let (first, second) = (cells(one), cells(other));
    first.iter().any(|at| FACES.iter().any(|face| second.contains(&moved(*at, *face))))
}

fn highest_by_stairs(build: &Build<'_>) -> Option<i64> {
    let cells = build.all();
    let is_step = |at: &At| cells.contains(at) && (1..=2).all(|up| !cells.contains(&moved(*at, [0, up, 0])));
    let starts = cells.iter().copied().filter(|at| at[1] == 0 && is_step(at));
    let next = |at: At| {
        let steps = SIDES.iter().flat_map(|side| [moved(at, *side), moved(at, moved(*side, [0, 1, 0]))]);
        steps.filter(is_step).collect()
    };
    reached(starts, next).iter().map(|at| at[1]).max()
}

/// Returns where paths begin: at the blocks of a material, or in the middle.
fn starts(arguments: Arguments<'_>, build: &Build<'_>) -> BTreeSet<At> {
    let wanted = arguments.text("start_material").unwrap_or_default().to_lowercase();
    if wanted.is_empty() {
        return BTreeSet::from([[0, 1, 2].map(|axis| {
            let (least, most) = build.ends(axis);
            (least + most).div_euclid(2)
        })]);
    }
    build.cells(|name| name.to_lowercase().contains(&wanted))
}

fn is_single_level(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    if build.blocks.is_empty() {
        return true;
    }
    let y = build.ends(1).0;
    if y > -1 {
        return false;
    }
    let (starts, solid) = (starts(arguments, build), build.cells(|name| !is_door(name)));
    let mut floor: BTreeSet<Flat> = build.level(y);
    if !arguments.text("start_material").unwrap_or_default().is_empty() {
        floor.extend(starts.iter().filter(|at| at[1] == y + 1).map(|at| (at[0], at[2])));
    }
    let is_solid = |(x, z): Flat, y: i64| solid.contains(&[x, y, z]);
    let is_outside = |(x, z): Flat| {
        let is_beyond = |at: i64, along: fn(&Flat) -> i64| {
            floor.iter().all(|place| along(place) < at) || floor.iter().all(|place| along(place) > at)
        };
        is_beyond(x, |at| at.0) || is_beyond(z, |at| at.1)
    };
    let has_head_room = |at: Flat| !is_solid(at, if is_solid(at, y + 1) { y + 2 } else { y + 1 });
    let can_enter = |at: Flat| {
        if floor.contains(&at) { has_head_room(at) } else { is_outside(at) && !is_solid(at, y) && !is_solid(at, y + 1) }
    };
    let steps =
        |at: At| SIDES.iter().map(|side| moved(at, *side)).filter(|at| can_enter((at[0], at[2]))).collect::<Vec<_>>();
    starts.iter().all(|start| {
        let inside = |at: At| if is_outside((at[0], at[2])) { Vec::new() } else { steps(at) };
        let gets_out = || reached(steps(*start), inside).iter().any(|at| is_outside((at[0], at[2])));
        start[1] == y + 1 && can_enter((start[0], start[2])) && gets_out()
    })
}

fn has_exit(arguments: Arguments<'_>, build: &Build<'_>, [width, height, depth]: At) -> bool {
    if build.blocks.is_empty() {
        return true;
    }
    let starts = starts(arguments, build);
    let ends = [0, 1, 2].map(|axis| build.ends(axis));
    let solid = build.cells(|name| !is_door(name) && !name.to_lowercase().contains("bed"));
    let escapes = |size: At| {
        // The block at `at` is in the way of a box whose least corner is here.
        let fits = |corner: &At| {
            !solid.iter().any(|at| (0..3).all(|axis| (0..size[axis]).contains(&(at[axis] - corner[axis]))))
        };
        let is_out = |corner: &At| {
            let is_beyond = |axis: usize, by: i64| !(ends[axis].0..=ends[axis].1).contains(&(corner[axis] + by));
            let corners = [0, size[0] - 1].into_iter().flat_map(|dx| [(dx, 0), (dx, size[2] - 1)]);
            corners.into_iter().all(|(dx, dz)| is_beyond(0, dx) || is_beyond(2, dz))
        };
        let next = |corner: At| {
            let moves = SIDES.iter().flat_map(|side| (-1..=1).map(move |dy| moved(corner, moved(*side, [0, dy, 0]))));
            let is_within = |at: &At| (ends[1].0..=ends[1].1).contains(&at[1]);
            if is_out(&corner) { Vec::new() } else { moves.filter(is_within).filter(fits).collect() }
        };
        let beside = starts.iter().flat_map(|start| SIDES.iter().map(|side| moved(*start, *side)));
        reached(starts.iter().copied().chain(beside).filter(fits), next).iter().any(is_out)
    };
    starts.is_empty() || escapes([width, height, depth]) || escapes([depth, height, width])
}
