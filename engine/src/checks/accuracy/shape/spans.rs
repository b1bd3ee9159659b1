//! Strict rule for bridges: two supports, free cells between them, and a deck across (`docs/rules.md#strict-rules`).

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::arch::{ClearSpan, cuts};
use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::Cell;
use crate::voxel::planar::{Clusters, Touch, level};

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
}

const fn one() -> u32 {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_one(n: &u32) -> bool {
    *n == 1
}

impl Rule for HasClearSpan {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let structure = subject.structure;
        let required = subject.tell(
            || json!({ "supports": 2, "free": { ">=": self.min_free }, "clear levels": self.height, "deck": true }),
        );
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
                    format!("{free} between the supports at y = {y}; required {}", self.min_free)
                });
                return fails(subject.tell(|| json!({ "supports": 2, "free": free })), summary);
            }
            span = span.or(here);
        }
        let Some(span) = span else { return fails(json!({ "supports": 2, "free": 0 }), "no clear span".to_owned()) };
        let is_deck = |heights: &[i32]| heights.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1);
        let mut decks = cuts(structure, span, height - 1);
        decks.retain(|cut| is_deck(&cut.upper));
        let rows = decks.chunk_by(|a, b| a.across + 1 == b.across).find(|rows| rows.len() >= self.min_width as usize);
        let crossing = rows.and_then(<[_]>::first);
        let measured = subject.tell(|| json!({ "supports": 2, "free": span.length(), "deck": crossing.is_some() }));
        let summary = subject.tell(|| {
            let (cells, axis) = (counted(span.length(), "free cell"), span.axis.name());
            match crossing {
                Some(_) => format!("a deck crosses the {cells} along {axis}"),
                None if !decks.is_empty() => {
                    format!("no deck {} wide crosses the {cells} along {axis}", self.min_width)
                }
                None => format!("no deck without gaps and high steps crosses the {cells} along {axis}"),
            }
        });
        Finding::binary(crossing.is_some(), measured, required, summary)
            .with_witnesses(crossing.map(|cut| span.axis.cell(span.first, cut.across, cut.upper[0])), "deck")
    }
}
