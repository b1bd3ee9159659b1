//! True arches: our own rule in addition to the published surface rules, which reject the underside of every arch
//! (`docs/rules.md#strict-rules`).
//!
//! The supports are the two clusters of one level, and the clear span is the gap between them. An arch has a cut along
//! the span whose underside rises from both supports and bulges up, and whose upper surface does likewise. Heights are
//! whole blocks, which only approximate a bulging curve: each height may lie less than one block below any chord. That
//! allows every concave curve rounded down to blocks, and no dip.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::planar::{Clusters, PlaneCell, Touch, level};
use crate::voxel::{Cell, Structure};

/// Check that between two supports, underside and upper surface of some cut both rise from the ends and bulge up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueArch {
    /// Level of the supports. Blocks at or below it between them are not part of the arch.
    #[serde(default)]
    pub support_y: i32,
    /// Whether the upper surface may also be judged over the supports and the span together.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub with_supports: bool,
    /// Least number of blocks by which the underside rises above both its ends.
    #[serde(default, skip_serializing_if = "super::is_zero")]
    pub min_rise: u32,
    /// Whether what nothing can be built of, such as water, torches and doors, is left out.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub solid: bool,
}

/// Horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    X,
    Z,
}

impl Axis {
    const fn along(self, (x, z): PlaneCell) -> i32 {
        match self {
            Self::X => x,
            Self::Z => z,
        }
    }

    const fn across(self, (x, z): PlaneCell) -> i32 {
        match self {
            Self::X => z,
            Self::Z => x,
        }
    }

    pub(super) const fn cell(self, along: i32, across: i32, y: i32) -> Cell {
        match self {
            Self::X => Cell::new(along, y, across),
            Self::Z => Cell::new(across, y, along),
        }
    }

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Z => "z",
        }
    }
}

/// Free columns between two supports.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClearSpan {
    pub(super) axis: Axis,
    pub(super) first: i32,
    pub(super) last: i32,
    /// Least and greatest position of the supports along the axis.
    pub(super) ends: (i32, i32),
}

impl ClearSpan {
    /// Returns the span between the two clusters of a level along the axis with the wider gap, or `None` if there is no
    /// gap along either axis.
    pub(super) fn between(cells: &[PlaneCell], clusters: &Clusters) -> Option<Self> {
        let extent = |axis: Axis, cluster: u32| {
            let own = cells.iter().zip(&clusters.label).filter(|(_, label)| **label == cluster);
            let along = own.map(|(cell, _)| axis.along(*cell));
            (along.clone().min().unwrap_or(0), along.max().unwrap_or(0))
        };
        let gap = |axis: Axis| {
            let (a, b) = (extent(axis, 0), extent(axis, 1));
            let (near, far) = if a.0 <= b.0 { (a, b) } else { (b, a) };
            (near.1 + 1 < far.0).then_some(Self { axis, first: near.1 + 1, last: far.0 - 1, ends: (near.0, far.1) })
        };
        [gap(Axis::X), gap(Axis::Z)].into_iter().flatten().max_by_key(|span| span.last - span.first)
    }

    pub(super) const fn length(&self) -> usize {
        self.last.abs_diff(self.first) as usize + 1
    }
}

/// Heights of the lowest and highest block above the supports, for each column of a cut over the whole clear span.
#[derive(Debug)]
pub(super) struct Cut {
    pub(super) across: i32,
    pub(super) underside: Vec<i32>,
    pub(super) upper: Vec<i32>,
}

/// Place of a column across and along a span, and the heights of its lowest and highest block above the supports.
pub(super) type Column = ((i32, i32), (i32, i32));

/// Returns the columns over the clear span that have a block above the supports, those of each row together.
pub(super) fn columns_over(structure: &Structure, span: ClearSpan, support_y: i32) -> Vec<Column> {
    let mut columns: BTreeMap<(i32, i32), (i32, i32)> = BTreeMap::new();
    for cell in structure.cells().iter().filter(|cell| cell.y > support_y) {
        let (along, across) = (span.axis.along((cell.x, cell.z)), span.axis.across((cell.x, cell.z)));
        if (span.first..=span.last).contains(&along) {
            let (low, high) = columns.entry((across, along)).or_insert((cell.y, cell.y));
            (*low, *high) = ((*low).min(cell.y), (*high).max(cell.y));
        }
    }
    columns.into_iter().collect()
}

/// Returns the cuts that have a block over every column of the clear span.
pub(super) fn cuts(columns: &[Column], span: ClearSpan) -> Vec<Cut> {
    columns
        .chunk_by(|a, b| a.0.0 == b.0.0)
        .filter(|cut| cut.len() == span.length())
        .map(|cut| Cut {
            across: cut[0].0.0,
            underside: cut.iter().map(|(_, (low, _))| *low).collect(),
            upper: cut.iter().map(|(_, (_, high))| *high).collect(),
        })
        .collect()
}

/// Returns the greatest height of each column at or above the supports, by its places across and along the span.
fn highest_blocks(structure: &Structure, span: ClearSpan, support_y: i32) -> BTreeMap<(i32, i32), i32> {
    let mut highest = BTreeMap::new();
    for cell in structure.cells().iter().filter(|cell| cell.y >= support_y) {
        let at = (span.axis.across((cell.x, cell.z)), span.axis.along((cell.x, cell.z)));
        let high = highest.entry(at).or_insert(cell.y);
        *high = (*high).max(cell.y);
    }
    highest
}

/// Returns the heights of the upper surface of a cut over the span and, as far as they adjoin it, over the supports.
fn upper_with_supports(highest: &BTreeMap<(i32, i32), i32>, span: ClearSpan, cut: &Cut) -> Vec<i32> {
    let height = |along: i32| highest.get(&(cut.across, along)).copied();
    let mut heights: Vec<i32> = (span.ends.0..span.first).rev().map_while(height).collect();
    heights.reverse();
    heights.extend(&cut.upper);
    heights.extend((span.last + 1..=span.ends.1).map_while(height));
    heights
}

/// Returns the index where a surface fails to bulge up, or `None` if it bulges. It fails at an end that is as high as
/// any other point, or where it dips a block or more below a chord.
pub(super) fn break_of(heights: &[i32]) -> Option<usize> {
    let highest = heights.iter().max().copied().unwrap_or(0);
    if heights.first() == Some(&highest) {
        return Some(0);
    }
    if heights.last() == Some(&highest) {
        return Some(heights.len() - 1);
    }
    // The upper hull is the highest of all chords at each index.
    let point = |i: usize| (i as i64, i64::from(heights[i]));
    let mut hull: Vec<usize> = Vec::new();
    for i in 0..heights.len() {
        while let [.., a, b] = hull[..]
            && is_below(point(b), point(a), point(i), 0)
        {
            hull.pop();
        }
        hull.push(i);
    }
    let is_dip = |i: &usize, ends: &[usize]| is_below(point(*i), point(ends[0]), point(ends[1]), 1);
    hull.windows(2).find_map(|ends| (ends[0] + 1..ends[1]).find(|i| is_dip(i, ends)))
}

/// Returns by how many blocks the highest of some heights lies above the higher of both ends.
fn rise_of(heights: &[i32]) -> i64 {
    let highest = heights.iter().max().copied().unwrap_or(0);
    let end = heights.first().max(heights.last()).copied().unwrap_or(0);
    i64::from(highest) - i64::from(end)
}

/// Returns whether `p`, raised by `by`, lies on or below the chord from `a` to `b`.
const fn is_below(p: (i64, i64), a: (i64, i64), b: (i64, i64), by: i64) -> bool {
    (p.1 + by) * (b.0 - a.0) <= a.1 * (b.0 - p.0) + b.1 * (p.0 - a.0)
}

impl Rule for TrueArch {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| {
            let mut required =
                json!({ "supports": 2, "y": self.support_y, "underside": "bulges up", "upper_surface": "bulges up" });
            if self.min_rise > 0 {
                required["rise"] = json!({ ">=": self.min_rise });
            }
            required
        });
        let structure = subject.standing(self.solid);
        if structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let cells = level(structure, self.support_y);
        let clusters = Clusters::of(&cells, Touch::Sides);
        let fails = |measured, summary: String| Finding::binary(false, measured, required.clone(), summary);
        if clusters.count != 2 {
            let summary = subject.tell(|| {
                format!("{} at y = {}; an arch has two", counted(clusters.count, "separate support"), self.support_y)
            });
            let supports = subject.tell(|| clusters.representatives(&cells)).into_iter();
            return fails(json!({ "supports": clusters.count }), summary)
                .with_witnesses(supports.map(|(x, z)| Cell::new(x, self.support_y, z)), "first block of a support");
        }
        let Some(span) = ClearSpan::between(&cells, &clusters) else {
            return fails(json!({ "supports": 2, "clear_span": 0 }), "no clear span separates the supports".to_owned());
        };
        let axis = span.axis.name();
        let cuts = cuts(&columns_over(structure, span, self.support_y), span);
        let measured = |surfaces: Option<&Cut>| {
            json!({ "supports": 2, "clear_span": span.length(), "axis": axis,
                    "underside": surfaces.map(|cut| &cut.underside), "upper_surface": surfaces.map(|cut| &cut.upper) })
        };
        let highest =
            if self.with_supports { highest_blocks(structure, span, self.support_y) } else { BTreeMap::new() };
        let rises = |cut: &Cut| {
            break_of(&cut.upper).is_none()
                || self.with_supports && break_of(&upper_with_supports(&highest, span, cut)).is_none()
        };
        let is_high = |cut: &Cut| rise_of(&cut.underside) >= i64::from(self.min_rise);
        let holds = |cut: &&Cut| break_of(&cut.underside).is_none() && is_high(cut) && rises(cut);
        if let Some(cut) = cuts.iter().find(holds) {
            let summary = subject.tell(|| format!("an arch over {} clear blocks along {axis}", span.length()));
            return Finding::binary(true, measured(Some(cut)), required, summary);
        }
        let Some(cut) = cuts.first() else {
            return fails(measured(None), format!("nothing spans the {} clear blocks along {axis}", span.length()));
        };
        if break_of(&cut.underside).is_none() && !is_high(cut) {
            let rise = counted(rise_of(&cut.underside), "block");
            let summary =
                subject.tell(|| format!("the underside rises by {rise}; required at least {}", self.min_rise));
            return fails(measured(Some(cut)), summary);
        }
        let (name, at, heights) = match break_of(&cut.underside) {
            Some(at) => ("underside", at, &cut.underside),
            None => ("upper surface", break_of(&cut.upper).unwrap_or(0), &cut.upper),
        };
        let why = if heights.iter().max() == Some(&heights[at]) { "does not rise" } else { "dips" };
        let place = span.axis.cell(span.first + i32::try_from(at).unwrap_or(0), cut.across, heights[at]);
        let finding = fails(measured(Some(cut)), format!("the {name} {why} at {:?}", <[i32; 3]>::from(place)));
        finding.with_witnesses([place], why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bulges(heights: &[i32]) -> bool {
        break_of(heights).is_none()
    }

    #[test]
    fn what_bulges() {
        assert!(bulges(&[1, 2, 3, 2, 1]));
        assert!(bulges(&[1, 2, 2, 2, 1]));
        assert!(bulges(&[0, 2, 3, 3, 4, 4, 4, 3, 3, 2, 0]), "a circle in blocks");
        assert!(!bulges(&[2, 2, 2]), "flat");
        assert!(!bulges(&[1, 2, 3]), "rises on one side only");
        assert!(!bulges(&[1, 3, 2, 3, 1]), "dips");
        assert!(!bulges(&[1, 1, 1, 5, 1, 1, 1]), "a post on a flat deck");
        assert!(!bulges(&[3, 2, 1, 2, 3]), "hangs");
    }

    fn stone(cells: impl IntoIterator<Item = [i32; 3]>) -> Structure {
        Structure::from_named(cells.into_iter().map(|[x, y, z]| (Cell::new(x, y, z), "stone")))
    }

    fn finding(structure: &Structure) -> Finding {
        TrueArch { support_y: 0, with_supports: false, min_rise: 0, solid: false }
            .evaluate(&Subject::unhurried(structure))
    }

    #[test]
    fn a_flat_bridge_and_a_hanging_one_are_no_arches() {
        let piers = || (0..3).flat_map(|y| [[0, y, 0], [6, y, 0]]);
        let deck = |height: [i32; 5]| (1..6).zip(height).map(|(x, y)| [x, y, 0]);
        assert!(finding(&stone(piers().chain(deck([3, 4, 5, 4, 3])))).holds());
        let rises = |min_rise, height| {
            let rule = TrueArch { support_y: 0, with_supports: false, min_rise, solid: true };
            rule.evaluate(&Subject::unhurried(&stone(piers().chain(deck(height)))))
        };
        assert!(rises(2, [3, 4, 5, 4, 3]).holds() && !rises(3, [3, 4, 5, 4, 3]).holds());
        let plank = rises(2, [3, 4, 4, 4, 3]);
        assert_eq!(plank.summary, "the underside rises by 1 block; required at least 2");
        let flat = finding(&stone(piers().chain(deck([3; 5]))));
        assert_eq!((flat.score, flat.summary.as_str()), (0.0, "the underside does not rise at [1, 3, 0]"));
        assert!(!finding(&stone(piers().chain(deck([5, 4, 3, 4, 5])))).holds());
        assert!(!finding(&stone(piers())).holds(), "nothing spans");
        assert!(!finding(&stone([[0, 0, 0]])).holds(), "one support");
        let river = (1..6).map(|x| [x, -1, 0]);
        assert!(
            finding(&stone(piers().chain(deck([3, 4, 5, 4, 3])).chain(river))).holds(),
            "a river bed is no underside"
        );
    }

    /// The extrados 1, 2, 3, 4, 4, 4, 4, 4, 3, 2, 1 is level over the clear span alone.
    #[test]
    fn the_upper_surface_may_rise_over_the_supports() {
        let heights = [1, 2, 3, 4, 4, 4, 4, 4, 3, 2, 1];
        let supports = (0..11).zip(heights).filter(|(x, _)| !(3..8).contains(x));
        let stands = supports.flat_map(|(x, top)| (0..=top).map(move |y| [x, y, 0]));
        let over = (3..8).zip([2, 3, 4, 3, 2]).flat_map(|(x, low)| (low..=4).map(move |y| [x, y, 0]));
        let arch = stone(stands.chain(over));
        assert!(!finding(&arch).holds(), "judged over the span alone");
        let judged = TrueArch { support_y: 0, with_supports: true, min_rise: 0, solid: false };
        assert!(judged.evaluate(&Subject::unhurried(&arch)).holds());
    }

    #[test]
    fn a_flat_top_over_a_true_underside_is_no_arch() {
        let piers = (0..7).flat_map(|y| [[0, y, 0], [6, y, 0]]);
        let filled = (1..6).zip([3, 4, 5, 4, 3]).flat_map(|(x, low)| (low..7).map(move |y| [x, y, 0]));
        let found = finding(&stone(piers.chain(filled)));
        assert!(found.summary.starts_with("the upper surface does not rise"), "{}", found.summary);
    }

    proptest! {
        /// Compares with a test of every chord in integers.
        #[test]
        fn the_hull_tells_what_all_chords_tell(heights in prop::collection::vec(-3..5i32, 1..12)) {
            let (n, highest) = (heights.len(), *heights.iter().max().unwrap());
            let h = |i: usize| i64::from(heights[i]);
            let is_dip = |i: usize, k: usize, j: usize| {
                (h(k) + 1) * (j - i) as i64 <= h(i) * (j - k) as i64 + h(j) * (k - i) as i64
            };
            let dips = (0..n).any(|i| (i + 2..n).any(|j| (i + 1..j).any(|k| is_dip(i, k, j))));
            prop_assert_eq!(bulges(&heights), heights[0] < highest && heights[n - 1] < highest && !dips);
        }

        /// Compares arches along x and z, and at different positions.
        #[test]
        fn direction_and_place_do_not_matter(heights in prop::collection::vec(1..5i32, 3..8), dx in -9..9i32, dz in -9..9i32) {
            let far = heights.len() as i32 + 1;
            let cells: Vec<[i32; 3]> = [[0, 0, 0], [far, 0, 0]].into_iter()
                .chain((1..).zip(&heights).map(|(x, y)| [x, *y, 0])).collect();
            let along_z = stone(cells.iter().map(|[x, y, z]| [z + dx, *y, x + dz]));
            prop_assert_eq!(finding(&stone(cells)).score, finding(&along_z).score);
        }
    }
}
