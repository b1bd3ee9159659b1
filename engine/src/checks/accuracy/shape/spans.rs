//! Strict rule for bridges: two supports, free cells between them, and a deck across (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::arch::{ClearSpan, Column, columns_over, cuts};
use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::planar::{Clusters, Touch, level};
use crate::voxel::{Cell, CellSet, Structure};

/// Check that every level from 0 up to a height has two supports with enough free cells between them, and that above, a
/// deck without gaps or steps of more than one block crosses these cells.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasClearSpan {
    /// Number of levels, from y = 0, that must be clear between the supports.
    pub height: u32,
    /// Least number of free cells between the supports, in a straight line.
    pub min_free: u32,
    /// Least width of the deck: the number of neighbouring rows that cross.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub min_width: u32,
    /// Whether deck and supports must be one piece: from the deck, blocks that share faces lead at y >= 0 to both supports
    /// on the ground.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub one_piece: bool,
    /// Whether what nothing can be built of, such as water, torches and doors, is left out.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub solid: bool,
}

const fn one() -> u32 {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_one(n: &u32) -> bool {
    *n == 1
}

/// Returns where the row that gets farthest stops being a deck, and why; `None` if nothing lies over the span.
fn break_of(columns: &[Column], span: ClearSpan) -> Option<(Cell, &'static str)> {
    let in_row = |row: &[Column]| {
        let mut last: Option<i32> = None;
        let mut rest = row.iter().peekable();
        for along in span.first..=span.last {
            let here = rest.next_if(|((_, at), _)| *at == along).map(|(_, (_, high))| *high);
            let why = match (last, here) {
                (Some(last), Some(here)) if last.abs_diff(here) > 1 => "high step",
                (_, Some(_)) => {
                    last = here;
                    continue;
                }
                (_, None) => "gap",
            };
            let y = here.or(last).unwrap_or(row[0].1.1);
            return Some((along, (span.axis.cell(along, row[0].0.0, y), why)));
        }
        None
    };
    let breaks = columns.chunk_by(|a, b| a.0.0 == b.0.0).filter_map(in_row);
    // Of rows that get equally far, the first.
    breaks.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, found)| found)
}

/// Returns the first cell of a support on the ground to which no blocks that share faces lead, at y >= 0, from the deck.
fn loose_support(structure: &Structure, deck: Cell) -> Option<Cell> {
    let mut open = vec![deck];
    let mut seen: CellSet = open.iter().copied().collect();
    while let Some(cell) = open.pop() {
        let next = cell.face_neighbours().into_iter().filter(|next| next.y >= 0 && structure.contains(*next));
        open.extend(next.filter(|next| seen.insert(*next)));
    }
    let cells = level(structure, 0);
    let clusters = Clusters::of(&cells, Touch::SidesAndCorners);
    let mut is_joined = vec![false; clusters.count];
    for ((x, z), label) in cells.iter().zip(&clusters.label) {
        is_joined[*label as usize] |= seen.contains(&Cell::new(*x, 0, *z));
    }
    let (x, z) = clusters.representatives(&cells).into_iter().zip(is_joined).find(|(_, joined)| !joined)?.0;
    Some(Cell::new(x, 0, z))
}

impl Rule for HasClearSpan {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let structure = subject.standing(self.solid);
        let required = subject.tell(|| {
            let free = json!({ ">=": self.min_free });
            let mut required = json!({ "supports": 2, "free": free, "clear_levels": self.height, "deck": true });
            if self.one_piece {
                required["one_piece"] = json!(true);
            }
            required
        });
        if structure.is_empty() {
            return Finding::nothing_stands(false, required);
        }
        let fails = |measured: Value, summary: String| Finding::binary(false, measured, required.clone(), summary);
        let mut span: Option<ClearSpan> = None;
        let height = i32::try_from(self.height).unwrap_or(i32::MAX);
        for y in 0..height.max(1) {
            let cells = level(structure, y);
            // Supports that touch at an edge count as one.
            let clusters = Clusters::of(&cells, Touch::SidesAndCorners);
            if clusters.count != 2 {
                let measured = subject.tell(|| json!({ "supports": clusters.count, "y": y }));
                let summary = subject
                    .tell(|| format!("{} at y = {y}; a bridge has two", counted(clusters.count, "separate support")));
                let supports = subject.tell(|| clusters.representatives(&cells)).into_iter();
                return fails(measured, summary)
                    .with_witnesses(supports.map(|(x, z)| Cell::new(x, y, z)), "first block of a support");
            }
            let here = ClearSpan::between(&cells, &clusters);
            let free = here.map_or(0, |here| here.length());
            if free < self.min_free as usize {
                let summary = subject.tell(|| {
                    let free = counted(free, "free cell");
                    format!("{free} between the supports at y = {y}; required at least {}", self.min_free)
                });
                return fails(subject.tell(|| json!({ "supports": 2, "free": free })), summary);
            }
            span = span.or(here);
        }
        let Some(span) = span else { return fails(json!({ "supports": 2, "free": 0 }), "no clear span".to_owned()) };
        let is_deck = |heights: &[i32]| heights.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1);
        let columns = columns_over(structure, span, height - 1);
        let mut decks = cuts(&columns, span);
        decks.retain(|cut| is_deck(&cut.upper));
        let mut widths = decks.chunk_by(|a, b| a.across + 1 == b.across);
        let widest = subject.tell(|| widths.clone().map(<[_]>::len).max().unwrap_or(0));
        let crossing = widths.find(|rows| rows.len() >= self.min_width as usize).and_then(<[_]>::first);
        let broken = subject.tell(|| break_of(&columns, span).filter(|_| decks.is_empty()));
        let begin = crossing.map(|cut| span.axis.cell(span.first, cut.across, cut.upper[0]));
        let loose = begin.filter(|_| self.one_piece).and_then(|deck| loose_support(structure, deck));
        let measured = subject.tell(|| {
            let mut measured = json!({ "supports": 2, "free": span.length(), "deck": crossing.is_some() });
            if self.one_piece {
                measured["one_piece"] = json!(crossing.is_some() && loose.is_none());
            }
            measured
        });
        let summary = subject.tell(|| {
            let (cells, axis) = (counted(span.length(), "free cell"), span.axis.name());
            match (crossing, broken) {
                _ if loose.is_some() => {
                    format!("the deck over the {cells} along {axis} is no one piece with a support")
                }
                (Some(_), _) => format!("a deck crosses the {cells} along {axis}"),
                (None, Some((place, why))) => {
                    format!("no deck crosses the {cells} along {axis}: {why} at {:?}", <[i32; 3]>::from(place))
                }
                (None, None) if widest > 0 => format!(
                    "a deck {} wide crosses the {cells} along {axis}; required a width of at least {}",
                    counted(widest, "block"),
                    self.min_width
                ),
                (None, None) => format!("nothing lies over the {cells} along {axis}"),
            }
        });
        Finding::binary(crossing.is_some() && loose.is_none(), measured, required, summary)
            .with_witnesses(loose, "support apart from the deck")
            .with_witnesses(begin, "deck")
            .with_witnesses(broken.map(|(place, _)| place), broken.map_or("", |(_, why)| why))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(min_width: u32, deck: &[[i32; 3]]) -> Finding {
        let piers = (0..2).flat_map(|y| [[0, y, 0], [4, y, 0]]);
        let all = piers.chain(deck.iter().copied());
        let bridge = Structure::from_named(all.map(|[x, y, z]| (Cell::new(x, y, z), "stone")));
        HasClearSpan { height: 2, min_free: 3, min_width, one_piece: false, solid: false }
            .evaluate(&Subject::unhurried(&bridge))
    }

    #[test]
    fn a_stub_under_the_end_of_a_deck_is_no_support() {
        let build = |second: std::ops::Range<i32>| {
            let deck = (1..=4).map(|x| [x, 6, 0]);
            let all = (0..=6).map(|y| [0, y, 0]).chain(deck).chain(second.map(|y| [4, y, 0]));
            Structure::from_named(all.map(|[x, y, z]| (Cell::new(x, y, z), "stone")))
        };
        let found = |one_piece, second| {
            let rule = HasClearSpan { height: 2, min_free: 3, min_width: 1, one_piece, solid: true };
            rule.evaluate(&Subject::unhurried(&build(second)))
        };
        assert!(found(true, 0..6).holds() && found(false, 0..2).holds());
        let stub = found(true, 0..2);
        assert_eq!(stub.summary, "the deck over the 3 free cells along x is no one piece with a support");
        assert_eq!(<[i32; 3]>::from(stub.witnesses[0].cell), [4, 0, 0]);
    }

    #[test]
    fn a_deck_that_breaks_says_where() {
        for (width, deck, wanted, marked) in [
            (
                1,
                vec![[1, 2, 0], [2, 2, 0], [3, 2, 0]],
                "a deck crosses the 3 free cells along x",
                Some(([1, 2, 0], "deck")),
            ),
            (1, vec![], "nothing lies over the 3 free cells along x", None),
            (
                1,
                vec![[1, 2, 0], [3, 2, 0], [1, 3, 1], [2, 3, 1]],
                "no deck crosses the 3 free cells along x: gap at [3, 3, 1]",
                Some(([3, 3, 1], "gap")),
            ),
            (
                1,
                vec![[1, 2, 0], [2, 5, 0], [3, 2, 0]],
                "no deck crosses the 3 free cells along x: high step at [2, 5, 0]",
                Some(([2, 5, 0], "high step")),
            ),
            (
                2,
                vec![[1, 2, 0], [2, 2, 0], [3, 2, 0]],
                "a deck 1 block wide crosses the 3 free cells along x; required a width of at least 2",
                None,
            ),
        ] {
            let found = finding(width, &deck);
            assert_eq!(found.summary, wanted);
            let shown = found.witnesses.first().map(|witness| (<[i32; 3]>::from(witness.cell), &*witness.why));
            assert_eq!(shown, marked, "{wanted}");
            assert_eq!(found.holds(), wanted.starts_with("a deck crosses"));
        }
    }
}
