//! Strict rule for ceilings: rooms with ceilings at several levels (`docs/rules.md#strict-rules`).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::enclosed::without_terrain;
use crate::checks::{Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::Cell;
use crate::voxel::inside::LEAST_FLOOR;

/// Check that the ceilings of the rooms lie at enough different levels, each over enough cells of floor.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasCeilings {
    /// Least number of different levels.
    #[serde(default = "one")]
    pub min_levels: u32,
    /// Least number of floor cells below a ceiling of each level.
    #[serde(default = "four")]
    pub min_cells: u32,
    /// Least level of the highest ceiling; null for any.
    #[serde(default)]
    pub min_top: Option<i32>,
    /// Greatest step of a walk from the ground around the build to a floor of the room, in blocks: 0 or 1; null asks for
    /// no such walk. Steps of 1 include ladders.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_step: Option<u32>,
}

const fn one() -> u32 {
    1
}

const fn four() -> u32 {
    4
}

impl Rule for HasCeilings {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ "levels": { ">=": self.min_levels }, "top": { ">=": self.min_top } }));
        let Some(around) = subject.surroundings() else {
            return without_terrain(subject, required);
        };
        let (terrain, spaces) = (&around.terrain, around.spaces());
        let rooms = around.rooms_within(LEAST_FLOOR, self.max_step);
        let mut over: BTreeMap<i32, (u32, Cell)> = BTreeMap::new();
        for feet in terrain.cells_of(spaces, &rooms).filter(|cell| terrain.is_floor(*cell)) {
            if let Some(y) = terrain.ceiling_above(feet) {
                over.entry(y).or_insert((0, Cell::new(feet.x, y, feet.z))).0 += 1;
            }
        }
        over.retain(|_, (cells, _)| *cells >= self.min_cells);
        let levels: Vec<i32> = over.keys().copied().collect();
        let is_high = self.min_top.is_none_or(|top| levels.last().is_some_and(|level| *level >= top));
        let holds = levels.len() >= self.min_levels as usize && is_high;
        let summary = subject.tell(|| {
            let cells = counted(self.min_cells, "cell");
            match levels.as_slice() {
                [] => format!("no room has a ceiling over at least {cells} of floor"),
                [one] => format!("the ceilings over at least {cells} of floor lie at y = {one}"),
                levels => format!("ceilings over at least {cells} of floor lie at y = {levels:?}"),
            }
        });
        Finding::binary(holds, json!({ "levels": levels }), required, summary)
            .with_witnesses(over.into_values().map(|(_, cell)| cell), "ceiling")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::Structure;

    /// A hut of 8 by 5 blocks whose ceiling lies at y = 3 over one half and at y = 4 over the other.
    fn hut(second: i32) -> Structure {
        let mut blocks = Vec::new();
        for (x, z) in (0..8).flat_map(|x| (0..5).map(move |z| (x, z))) {
            let top = if x < 4 { 3 } else { second };
            let is_wall = x == 0 || x == 7 || z == 0 || z == 4;
            let from = if is_wall { 0 } else { top.min(3) };
            blocks
                .extend((from..=top).filter(|y| is_wall || *y == top || x == 4).map(|y| (Cell::new(x, y, z), "stone")));
        }
        blocks.retain(|(cell, _)| (cell.x, cell.z) != (2, 0) || cell.y > 1);
        blocks.push((Cell::new(2, 0, 0), "oak_door"));
        Structure::from_named(blocks)
    }

    #[test]
    fn levels_are_counted_over_floors_of_rooms() {
        let holds = |second, min_levels, min_top| {
            HasCeilings { min_levels, min_cells: 4, min_top, max_step: Some(1) }
                .evaluate(&Subject::unhurried(&hut(second)))
                .holds()
        };
        assert!(holds(3, 1, None) && !holds(3, 2, None));
        assert!(holds(4, 2, Some(4)) && !holds(4, 2, Some(5)) && !holds(4, 3, None));
        let chimney = Structure::from_named((4..9).map(|y| (Cell::new(1, y, 1), "bricks")));
        let both = Structure::from_named(
            hut(3).cells().iter().chain(chimney.cells()).map(|cell| (*cell, "stone")).collect::<Vec<_>>(),
        );
        let found = HasCeilings { min_levels: 2, min_cells: 4, min_top: None, max_step: None }
            .evaluate(&Subject::unhurried(&both));
        assert!(!found.holds(), "a chimney is no ceiling: {}", found.summary);
    }
}
