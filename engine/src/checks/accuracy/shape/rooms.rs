//! Rooms: enclosed air on one level (`docs/rules.md#shape`; paper, algorithm "Room Counting").

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::is_door;
use crate::checks::sample::MAX_WITNESSES;
use crate::checks::{Amount, Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::Cell;
use crate::voxel::planar::sorted_distinct;
use crate::voxel::rooms::FloorPlan;

/// Check that a level has enough enclosed regions of air. Doors one level below count as walls, because they are two
/// blocks high.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasRooms {
    /// Least number of rooms; with 0 or less the check always holds.
    pub room_cnt: Amount,
    /// The level.
    #[serde(default = "default_y")]
    pub y: i32,
}

const fn default_y() -> i32 {
    2
}

impl Rule for HasRooms {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ ">=": self.room_cnt }));
        if self.room_cnt.0 <= 0.0 {
            return Finding::binary(true, json!(null), required, "no room is required").vacuous_if(true);
        }
        let structure = subject.structure;
        let door = structure.palette().mask(is_door);
        let is_wall = |y: i32, id: u32| y == self.y || (y == self.y.saturating_sub(1) && door[id as usize]);
        let walls = structure.entries().filter(|(cell, id)| is_wall(cell.y, *id)).map(|(cell, _)| (cell.x, cell.z));
        let plan = FloorPlan::of(sorted_distinct(walls.collect()));
        let found = plan.rooms().len();
        let holds = found as f64 >= self.room_cnt.0;
        let summary = subject
            .tell(|| format!("{} at y = {}; required at least {}", counted(found, "room"), self.y, self.room_cnt));
        let raised = |(x, z): (i32, i32)| Cell::new(x, self.y, z);
        let finding = Finding::binary(holds, found, required, summary)
            .with_witnesses(plan.rooms().iter().map(|room| raised(room.first)), "room");
        if holds {
            return finding;
        }
        finding.with_witnesses(plan.leaks(MAX_WITNESSES).into_iter().map(raised), "leaks")
    }
}
