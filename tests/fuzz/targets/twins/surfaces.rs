//! Surfaces that bulge, mirror images, and vaults.

use std::collections::{BTreeMap, BTreeSet};

use super::bridges::bulges as arches;
use super::{Arguments, Build, Flat, parts};

pub fn holds(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    match rule {
        "is_top_surface_concave" => Some(some_slice_bulges(arguments, build, 1)),
        "is_bottom_surface_concave" => Some(some_slice_bulges(arguments, build, -1)),
        "has_axis_symmetry" => Some(build.blocks.is_empty() || is_symmetric(build)),
        "has_no_axis_symmetry" => Some(!build.blocks.is_empty() && !is_symmetric(build)),
        "is_vault" => Some(!build.blocks.is_empty() && is_vault(arguments, build)),
        _ => None,
    }
}

/// Returns the greatest height of each column, or with a negative sign the least.
fn surface(build: &Build<'_>, sign: i64) -> BTreeMap<Flat, i64> {
    let mut heights = BTreeMap::new();
    for block in &build.blocks {
        let height = heights.entry((block.at[0], block.at[2])).or_insert(block.at[1]);
        *height = sign * (sign * *height).max(sign * block.at[1]);
    }
    heights
}

fn some_slice_bulges(arguments: Arguments<'_>, build: &Build<'_>, sign: i64) -> bool {
    let heights = surface(build, sign);
    let fixed = |along: fn(&Flat) -> i64| -> Vec<Vec<i64>> {
        let lines: BTreeSet<i64> = heights.keys().map(along).collect();
        let slice = |line: &i64| heights.iter().filter(|(at, _)| along(at) == *line).map(|(_, y)| *y).collect();
        lines.iter().map(slice).collect()
    };
    let slices = [fixed(|at| at.0), fixed(|at| at.1)].concat();
    build.blocks.is_empty() || slices.iter().any(|slice| bulges(slice, sign, arguments))
}

fn bulges(heights: &[i64], sign: i64, arguments: Arguments<'_>) -> bool {
    let (is_strict, is_not_flat) = (arguments.flag("strict", false), arguments.text("strict") == Some("non-flat"));
    if heights.len() == 1 {
        return !is_strict && !is_not_flat;
    }
    if is_not_flat && heights.iter().all(|y| *y == heights[0])
        || is_strict && heights.windows(2).any(|two| two[0] == two[1])
    {
        return false;
    }
    let ends = (0..heights.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
    let mut points = ends.flat_map(|(i, j)| (i + 1..j).map(move |k| (i, k, j)));
    points.all(|(i, k, j)| {
        let [i, k, j] = [i, k, j].map(|at| (at as i64, heights[at]));
        let above = sign * (k.1 * (j.0 - i.0) - i.1 * (j.0 - k.0) - j.1 * (k.0 - i.0));
        if is_strict { above > 0 } else { above >= 0 }
    })
}

fn is_symmetric(build: &Build<'_>) -> bool {
    let cells = build.all();
    (0..3).any(|axis| {
        let (least, most) = build.ends(axis);
        let mirrored = cells.iter().map(|at| {
            let mut at = *at;
            at[axis] = least + most - at[axis];
            at
        });
        least < most && mirrored.collect::<BTreeSet<_>>() == cells
    })
}

fn is_vault(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    let above = Build {
        blocks: build.blocks.iter().filter(|block| block.at[1] >= 0).cloned().collect(),
        is_read_as_game: build.is_read_as_game,
    };
    let tops = surface(&above, 1);
    let cells = build.all();
    // Towards zero, where the middle lies between two columns.
    let judged = if arguments.flag("shell", false) && !above.blocks.is_empty() { &above } else { build };
    let middle = [0, 2].map(|axis| i64::midpoint(judged.ends(axis).0, judged.ends(axis).1));
    let middle_column = above.blocks.iter().filter(|block| [block.at[0], block.at[2]] == middle);
    let lowest = middle_column.map(|block| block.at[1]).min().unwrap_or(0);
    // The free cells below the cover of a column, which begins at its top and goes on as far as blocks do.
    let free = |at: &Flat, top: i64| {
        let below: Vec<bool> = (0..=top).rev().map(|y| cells.contains(&[at.0, y, at.1])).collect();
        below.into_iter().skip_while(|filled| *filled).take_while(|filled| !filled).count() as i64
    };
    let min_hollow = arguments.number("min_hollow").unwrap_or(0.0);
    let clear = match tops.get(&(middle[0], middle[1])) {
        Some(top) if arguments.flag("shell", false) => free(&(middle[0], middle[1]), *top),
        _ => lowest,
    };
    let span = |along: fn(&Flat) -> i64| -> Option<(i64, i64)> {
        Some((tops.keys().map(along).min()?, tops.keys().map(along).max()?))
    };
    let (Some(x), Some(z)) = (span(|at| at.0), span(|at| at.1)) else { return false };
    let rows_are_closed = (z.0..=z.1).all(|row| {
        let own: Vec<i64> = tops.keys().filter(|at| at.1 == row).map(|at| at.0).collect();
        own.iter().max().zip(own.iter().min()).is_none_or(|(most, least)| (*least..=*most).all(|x| own.contains(&x)))
    });
    let area = ((x.1 - x.0 + 1) * (z.1 - z.0 + 1)) as f64;
    let has_no_gap = |(at, top): (&Flat, &i64)| {
        let sides = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(dx, dz)| tops.get(&(at.0 + dx, at.1 + dz)));
        sides.iter().flatten().all(|low| (**low + 1..=*top).all(|y| cells.contains(&[at.0, y, at.1])))
    };
    let around: BTreeSet<Flat> = (x.0 - 1..=x.1 + 1)
        .flat_map(|column| (z.0 - 1..=z.1 + 1).map(move |row| (column, row)))
        .filter(|at| !tops.contains_key(at))
        .collect();
    let may_be_open = arguments.flag("shell", false);
    let is_closed = if may_be_open { parts(&around, true).len() == 1 } else { rows_are_closed };
    // The heights of a line by their places, with a dip where a shell is open between two of them.
    let joined = |places: Vec<(i64, i64)>| {
        let mut heights = Vec::new();
        for (i, (at, top)) in places.iter().enumerate() {
            let is_open = may_be_open && i > 0 && places[i - 1].0 + 1 < *at;
            heights.extend(is_open.then_some(-1));
            heights.push(*top);
        }
        heights
    };
    let along_x = joined(tops.iter().filter(|(at, _)| at.1 == middle[1]).map(|(at, top)| (at.0, *top)).collect());
    let along_z = joined(tops.iter().filter(|(at, _)| at.0 == middle[0]).map(|(at, top)| (at.1, *top)).collect());
    let opened = |line: Vec<i64>, own: (bool, bool)| {
        let before = (may_be_open && !own.0).then_some(-1);
        let after = (may_be_open && !own.1).then_some(-1);
        before.into_iter().chain(line).chain(after).collect::<Vec<i64>>()
    };
    let has = |column: i64, row: i64| tops.contains_key(&(column, row));
    let along_x = opened(along_x, (has(x.0, middle[1]), has(x.1, middle[1])));
    let along_z = opened(along_z, (has(middle[0], z.0), has(middle[0], z.1)));
    let is_at_edge = |at: &Flat| {
        [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().any(|(dx, dz)| !tops.contains_key(&(at.0 + dx, at.1 + dz)))
    };
    let edge: Vec<(&Flat, &i64)> = tops.iter().filter(|(at, _)| is_at_edge(at)).collect();
    let stands = |(at, top): &&(&Flat, &i64)| (0..=**top).all(|y| cells.contains(&[at.0, y, at.1]));
    let footing = edge.iter().filter(stands).count() as f64 / edge.len() as f64;
    let inner: Vec<(&Flat, &i64)> = tops.iter().filter(|(at, _)| !is_at_edge(at)).collect();
    let hollow = inner.iter().filter(|(at, top)| free(at, **top) > 0).count() as f64;
    let is_hollow = min_hollow <= 0.0 || !inner.is_empty() && hollow / inner.len() as f64 >= min_hollow;
    let bulges = [&along_x, &along_z].iter().all(|line| !line.is_empty() && arches(line));
    let heights = tops.values().map(|top| *top as f64);
    let (mean, most) = (heights.clone().sum::<f64>() / tops.len() as f64, heights.fold(0.0, f64::max));
    let is_high = most > 0.0 && mean / most >= 0.35;
    is_closed
        && is_hollow
        && (!arguments.flag("shell", false) || bulges && is_high)
        && footing >= arguments.number("min_footing").unwrap_or(0.0)
        && tops.len() as f64 / area >= arguments.number("min_cover").unwrap_or(0.0)
        && (!arguments.flag("no_gaps", false) || tops.iter().all(has_no_gap))
        && clear as f64 >= arguments.number("min_clear").unwrap_or(0.0)
        && [along_x, along_z].iter().all(|line| falls(line))
}

/// Whether heights rise to a maximum, and fall by at least two on either side, without rising again.
fn falls(heights: &[i64]) -> bool {
    (0..heights.len()).any(|peak| {
        let rises = heights[..=peak].windows(2).all(|two| two[0] <= two[1]);
        let sinks = heights[peak..].windows(2).all(|two| two[0] >= two[1]);
        let ends = [heights[0], heights[heights.len() - 1]];
        rises && sinks && ends.iter().all(|end| end + 2 <= heights[peak])
    })
}
