//! Material: counts, shares of regions, and the parts of a build that a kind of block must make up.

use std::collections::BTreeSet;

use plumbline_engine::voxel::blocks::{BlockSet, is_air, is_door, is_known};

use super::world::World;
use super::{Arguments, At, Block, Build, SIDES, moved};

pub fn holds(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    let substring = arguments.flag("use_substring_match", false);
    let matching = |block: &&Block<'_>| {
        let wanted = arguments.text("expected_material").unwrap_or_default();
        let is_equal = if substring { block.name.contains(wanted) } else { block.name == wanted };
        !wanted.is_empty() && !block.name.is_empty() && is_equal
    };
    let count = || {
        let all = || build.blocks.iter();
        (if arguments.text("expected_material").is_some() { all().filter(matching).count() } else { all().count() })
            as f64
    };
    // Whether enough of the entries for which some key is greatest match.
    let share = |region: Vec<&Block<'_>>, keys: &[fn(At) -> i64], least: f64| {
        let attains =
            |block: &&Block<'_>, key: &fn(At) -> i64| region.iter().all(|other| key(other.at) <= key(block.at));
        let extreme: Vec<&Block<'_>> =
            region.iter().copied().filter(|block| keys.iter().any(|key| attains(block, key))).collect();
        let own = extreme.iter().copied().filter(|block| matching(block)).count();
        !extreme.is_empty() && own as f64 / extreme.len() as f64 >= least
    };
    let least = arguments.number("ratio_threshold").unwrap_or(0.5);
    let at_height = || {
        let y = arguments.integer("height_y", 2);
        build.blocks.iter().filter(|block| block.at[1] == y).collect::<Vec<_>>()
    };
    let all = || build.blocks.iter().collect::<Vec<_>>();
    Some(match rule {
        "is_block_cnt_equal_to" => count() == arguments.number("expected_count")?,
        "is_block_cnt_larger_than" => count() > arguments.number("cnt")?,
        "is_block_cnt_geq" => count() >= arguments.number("min_count")?,
        "is_block_cnt_leq" => count() <= arguments.number("max_count")?,
        "is_all_material_equal_to" => !build.blocks.is_empty() && build.blocks.iter().all(|block| matching(&block)),
        "is_corner_material_equal_to" => {
            let keys: [fn(At) -> i64; 4] =
                [|at| at[0] + at[2], |at| at[0] - at[2], |at| -at[0] + at[2], |at| -at[0] - at[2]];
            share(at_height(), &keys, least)
        }
        "is_min_x_material_equal_to" => share(at_height(), &[|at| -at[0]], least),
        "is_max_x_material_equal_to" => share(at_height(), &[|at| at[0]], least),
        "is_min_z_material_equal_to" => share(at_height(), &[|at| -at[2]], least),
        "is_max_z_material_equal_to" => share(at_height(), &[|at| at[2]], least),
        "is_highest_block_material_equal_to" => share(all(), &[|at| at[1]], least),
        "are_blocks_known" => {
            !build.blocks.is_empty() && build.blocks.iter().all(|block| is_known(block.name) && !is_air(block.name))
        }
        "count_is_within" => {
            let of = arguments.blocks("of");
            let is_counted = |block: &&Block<'_>| block.first_half.is_none() && of.is_none_or(|of| of.has(block.name));
            let count = build.blocks.iter().filter(is_counted).count() as f64;
            arguments.number("min").unwrap_or(0.0) <= count && arguments.number("max").is_none_or(|max| count <= max)
        }
        "is_made_of" => is_made_of(arguments, build)?,
        _ => return None,
    })
}

fn is_made_of(arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    let of = arguments.blocks("of")?;
    let except = arguments.blocks("except");
    let least = arguments.number("min_share").unwrap_or(1.0);
    let part = arguments.text("part")?;
    let fewest = if part == "corners" || part == "room_corners" { 4 } else { 1 };
    if part == "under_rooms" {
        return Some(!build.blocks.is_empty() && under_rooms(arguments, build, of) >= least);
    }
    let is_of = |group: &Vec<&Block<'_>>| {
        let rest = group.iter().filter(|block| except.is_none_or(|except| !except.has(block.name)));
        let own = rest.clone().filter(|block| of.has(block.name)).count();
        let share = if rest.clone().count() < fewest { 0.0 } else { own as f64 / rest.count() as f64 };
        share >= least
    };
    Some(!build.blocks.is_empty() && groups(part, arguments.integer("y", 0), build)?.iter().all(is_of))
}

/// Returns the share of the cells below rooms, on a level, in which a block of a kind lies. Where a cell is listed twice,
/// its first entry counts.
fn under_rooms(arguments: Arguments<'_>, build: &Build<'_>, of: BlockSet) -> f64 {
    let (y, except) = (arguments.integer("y", 0), arguments.blocks("except"));
    let Some(world) = World::of(build) else { return 0.0 };
    let air = world.rooms(4).into_iter().flatten().filter(|at| at[1] > y);
    let mut below: BTreeSet<At> = air.map(|at| [at[0], y, at[2]]).collect();
    let entry = |at: &At| build.blocks.iter().find(|block| block.at == *at);
    below.retain(|at| !entry(at).is_some_and(|block| except.is_some_and(|except| except.has(block.name))));
    let own = below.iter().filter(|at| entry(at).is_some_and(|block| of.has(block.name))).count();
    if below.is_empty() { 0.0 } else { own as f64 / below.len() as f64 }
}

/// Returns the groups of blocks that a part consists of.
fn groups<'a>(part: &str, y: i64, build: &'a Build<'a>) -> Option<Vec<Vec<&'a Block<'a>>>> {
    let all = || build.blocks.iter();
    let level: Vec<&Block<'_>> = all().filter(|block| block.at[1] == y).collect();
    // Whether a block lies at an end of the level along an axis: at the least or at the greatest coordinate.
    let is_at = |block: &Block<'_>, axis: usize, sign: i64| {
        level.iter().all(|other| sign * other.at[axis] <= sign * block.at[axis])
    };
    let is_at_end = |block: &Block<'_>, axis: usize| is_at(block, axis, 1) || is_at(block, axis, -1);
    let side = |axis: usize, sign: i64| {
        let own = level.iter().copied().filter(move |block| is_at(block, axis, sign));
        own.filter(move |block| !is_at_end(block, 2 - axis)).collect::<Vec<_>>()
    };
    Some(match part {
        "all" => vec![all().collect()],
        "corners" => vec![level.iter().copied().filter(|block| is_at_end(block, 0) && is_at_end(block, 2)).collect()],
        "sides" => vec![side(0, -1), side(0, 1), side(2, -1), side(2, 1)],
        "roof" => {
            let cells = build.all();
            let top = if build.blocks.is_empty() { 0 } else { build.ends(1).1 };
            let is_open = |block: &&Block<'_>| !cells.contains(&moved(block.at, [0, 1, 0]));
            vec![all().filter(is_open).filter(|block| 2 * block.at[1] >= top).collect()]
        }
        "room_walls" | "room_corners" | "room_roof" => vec![of_rooms(part, y, build)?],
        _ => return None,
    })
}

/// Returns the blocks of a part that rooms define; none of the roof where a cell is listed twice, as no rule says which
/// entry is the highest.
fn of_rooms<'a>(part: &str, y: i64, build: &'a Build<'a>) -> Option<Vec<&'a Block<'a>>> {
    let Some(world) = World::of(build) else { return Some(Vec::new()) };
    let air: BTreeSet<At> = world.rooms(4).into_iter().flatten().collect();
    if part == "room_roof" {
        let is_over = |block: &&Block<'_>| air.iter().any(|at| (at[0], at[2]) == (block.at[0], block.at[2]));
        let mut roof: Vec<&Block<'_>> = build.blocks.iter().filter(is_over).collect();
        let over = roof.clone();
        let same = |a: &Block<'_>, b: &Block<'_>| (a.at[0], a.at[2]) == (b.at[0], b.at[2]);
        roof.retain(|block| over.iter().all(|other| !same(block, other) || other.at[1] <= block.at[1]));
        return (build.all().len() == build.blocks.len()).then_some(roof);
    }
    let is_candidate = |block: &&Block<'_>| block.at[1] == y && !is_door(block.name) && !air.contains(&block.at);
    let is_beside = |block: &Block<'_>| SIDES.iter().any(|side| air.contains(&moved(block.at, *side)));
    let edges = |block: &Block<'_>| {
        let diagonals = [[1, 0, 1], [1, 0, -1], [-1, 0, 1], [-1, 0, -1]];
        diagonals.iter().filter(|diagonal| air.contains(&moved(block.at, **diagonal))).count()
    };
    let is_of_part = |block: &&Block<'_>| match part {
        "room_walls" => is_beside(block),
        _ => !is_beside(block) && edges(block) == 1,
    };
    Some(build.blocks.iter().filter(is_candidate).filter(is_of_part).collect())
}
