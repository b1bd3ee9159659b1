//! Arches and bridges: two supports and what crosses the gap between them.

use std::collections::{BTreeMap, BTreeSet};

use super::{Arguments, Build, Flat, SIDES, moved, parts};

/// The gap between two supports along one axis in plan: 0 for x, 1 for z.
#[derive(Clone, Copy)]
struct Gap {
    axis: usize,
    first: i64,
    last: i64,
    ends: (i64, i64),
}

impl Gap {
    fn length(self) -> i64 {
        self.last - self.first + 1
    }
}

fn along((x, z): Flat, axis: usize) -> i64 {
    [x, z][axis]
}

/// Returns the wider of the gaps that part two supports: that along z if both are as wide.
fn gap_between(one: &BTreeSet<Flat>, other: &BTreeSet<Flat>) -> Option<Gap> {
    let gap = |axis: usize| {
        let ends = |support: &BTreeSet<Flat>| {
            let along = || support.iter().map(|at| along(*at, axis));
            (along().min().expect("a place"), along().max().expect("a place"))
        };
        let (a, b) = (ends(one), ends(other));
        let (near, far) = if a.0 < b.0 { (a, b) } else { (b, a) };
        (near.1 + 1 < far.0).then_some(Gap { axis, first: near.1 + 1, last: far.0 - 1, ends: (near.0, far.1) })
    };
    match (gap(0), gap(1)) {
        (Some(x), Some(z)) => Some(if x.length() > z.length() { x } else { z }),
        (x, z) => x.or(z),
    }
}

/// The heights of the blocks above a level, by their places across and along a gap.
fn heights(build: &Build<'_>, gap: Gap, above: i64) -> BTreeMap<Flat, BTreeSet<i64>> {
    let mut heights: BTreeMap<Flat, BTreeSet<i64>> = BTreeMap::new();
    for block in build.blocks.iter().filter(|block| block.at[1] > above) {
        let at = (block.at[0], block.at[2]);
        heights.entry((along(at, 1 - gap.axis), along(at, gap.axis))).or_default().insert(block.at[1]);
    }
    heights
}

/// Returns the rows across a gap that have a block over each place of it, with the heights there.
fn rows(build: &Build<'_>, gap: Gap, above: i64) -> Vec<(i64, Vec<BTreeSet<i64>>)> {
    let heights = heights(build, gap, above);
    let all: BTreeSet<i64> = heights.keys().map(|at| at.0).collect();
    let row = |across: &i64| {
        let places = (gap.first..=gap.last).map(|along| heights.get(&(*across, along)).cloned());
        Some((*across, places.collect::<Option<Vec<_>>>()?))
    };
    all.iter().filter_map(row).collect()
}

/// Whether a surface rises from both ends and lies nowhere a whole block or more below a chord.
pub fn bulges(heights: &[i64]) -> bool {
    let most = heights.iter().max().expect("a height");
    let ends = (0..heights.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
    let mut points = ends.flat_map(|(i, j)| (i + 1..j).map(move |k| (i, k, j)));
    heights[0] < *most
        && heights[heights.len() - 1] < *most
        && points.all(|(i, k, j)| {
            let [i, k, j] = [i, k, j].map(|at| (at as i64, heights[at]));
            (k.1 + 1) * (j.0 - i.0) > i.1 * (j.0 - k.0) + j.1 * (k.0 - i.0)
        })
}

pub fn holds(rule: &str, arguments: Arguments<'_>, build: &Build<'_>) -> Option<bool> {
    match rule {
        "is_true_arch" => Some(is_true_arch(arguments, build)),
        "has_clear_span" => Some(has_clear_span(arguments, build)),
        _ => None,
    }
}

fn is_true_arch(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    let y = arguments.integer("support_y", 0);
    let [one, other] = &parts(&build.level(y), false)[..] else { return false };
    let Some(gap) = gap_between(one, other) else { return false };
    let supports = heights(build, gap, y - 1);
    let is_arch = |(across, places): &(i64, Vec<BTreeSet<i64>>)| {
        let low: Vec<i64> = places.iter().map(|at| *at.first().expect("a height")).collect();
        let high: Vec<i64> = places.iter().map(|at| *at.last().expect("a height")).collect();
        let top = |along: i64| supports.get(&(*across, along)).map(|at| *at.last().expect("a height"));
        let mut before: Vec<i64> = (gap.ends.0..gap.first).rev().map_while(top).collect();
        before.reverse();
        let after: Vec<i64> = (gap.last + 1..=gap.ends.1).map_while(top).collect();
        let whole = [&before[..], &high, &after].concat();
        let rise = low.iter().max().expect("a height") - low[0].max(low[low.len() - 1]);
        bulges(&low)
            && rise >= arguments.integer("min_rise", 0)
            && (bulges(&high) || arguments.flag("with_supports", false) && bulges(&whole))
    };
    rows(build, gap, y).iter().any(is_arch)
}

fn has_clear_span(arguments: Arguments<'_>, build: &Build<'_>) -> bool {
    if build.blocks.is_empty() {
        return false;
    }
    let height = arguments.integer("height", 0);
    let mut gaps = Vec::new();
    // No build of the fuzzer is as high as this.
    for y in 0..height.clamp(1, 100) {
        let [one, other] = &parts(&build.level(y), true)[..] else { return false };
        let gap = gap_between(one, other);
        if gap.map_or(0, Gap::length) < arguments.integer("min_free", 0) {
            return false;
        }
        gaps.extend(gap);
    }
    let Some(gap) = gaps.first().copied() else { return false };
    let is_deck = |row: &(i64, Vec<BTreeSet<i64>>)| {
        row.1.windows(2).all(|two| two[0].last().expect("a height").abs_diff(*two[1].last().expect("a height")) <= 1)
    };
    let decks: BTreeSet<i64> =
        rows(build, gap, height - 1).iter().filter(|row| is_deck(row)).map(|row| row.0).collect();
    let width = arguments.integer("min_width", 1);
    let is_wide =
        |first: &i64| width <= decks.len() as i64 && (0..width.max(1)).all(|more| decks.contains(&(first + more)));
    let Some(first) = decks.iter().find(|first| is_wide(first)).copied() else { return false };
    !arguments.flag("one_piece", false) || is_one_piece(build, gap, first, height - 1)
}

/// Whether both supports on the ground hang together, at y >= 0, with the block of a row's deck at one end of a gap.
fn is_one_piece(build: &Build<'_>, gap: Gap, row: i64, above: i64) -> bool {
    let heights = heights(build, gap, above);
    let top = *heights[&(row, gap.first)].last().expect("a height");
    let deck = if gap.axis == 0 { [gap.first, top, row] } else { [row, top, gap.first] };
    let all = build.all();
    let mut piece = BTreeSet::from([deck]);
    let steps = SIDES.into_iter().chain([[0, 1, 0], [0, -1, 0]]);
    while let Some(more) = all
        .iter()
        .find(|at| at[1] >= 0 && !piece.contains(*at) && steps.clone().any(|step| piece.contains(&moved(**at, step))))
    {
        piece.insert(*more);
    }
    let supports = parts(&build.level(0), true);
    supports.iter().all(|support| support.iter().any(|at| piece.contains(&[at.0, 0, at.1])))
}
