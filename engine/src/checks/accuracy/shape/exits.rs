//! Exits for a box of a given size (`docs/rules.md#ways-out`), which passes through doors and beds and needs no floor.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::contains_lower;
use crate::checks::{Finding, Subject};
use crate::elasticity::Stopped;
use crate::voxel::free_space::{BoxSize, FreeSpace};
use crate::voxel::{Bounds, Cell, Structure};

/// Check that a box of width x depth x height, in either orientation, can move out of the bounding box.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasExit {
    /// Width, in cells.
    #[serde(default = "two")]
    pub width: BoxSide,
    /// Depth, in cells.
    #[serde(default = "one")]
    pub depth: BoxSide,
    /// Height, in cells.
    #[serde(default = "two")]
    pub height: BoxSide,
    /// Starts at blocks whose lower-cased name contains this; null starts at the centre of the bounding box.
    #[serde(default)]
    pub start_material: Option<String>,
}

/// [`HasExit`] for a box that is as deep as it is wide and two cells high.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HasWideExit {
    /// Width and depth, in cells.
    #[serde(default = "two")]
    pub width: BoxSide,
    /// Starts at blocks whose lower-cased name contains this; null starts at the centre of the bounding box.
    #[serde(default)]
    pub start_material: Option<String>,
}

impl HasExit {
    /// Returns how much work a block of the build makes at most: the lines along z that it blocks for the box, in both
    /// orientations.
    #[must_use]
    pub const fn work(&self) -> u64 {
        ((self.width.0 + self.depth.0) * self.height.0) as u64
    }

    /// Scores the subject.
    ///
    /// # Errors
    /// Returns an error if the subject's control stops the search.
    pub fn evaluate(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        exit_finding(subject, [self.width.0, self.depth.0, self.height.0], self.start_material.as_deref())
    }
}

impl HasWideExit {
    /// Returns how much work a block of the build makes at most, as [`HasExit::work`] does.
    #[must_use]
    pub const fn work(&self) -> u64 {
        (self.width.0 * 2) as u64
    }

    /// Scores the subject.
    ///
    /// # Errors
    /// Returns an error if the subject's control stops the search.
    pub fn evaluate(&self, subject: &Subject<'_>) -> Result<Finding, Stopped> {
        exit_finding(subject, [self.width.0, self.width.0, 2], self.start_material.as_deref())
    }
}

/// Side length of the moving box: 1 to 16 cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "i64", into = "i64")]
pub struct BoxSide(i32);

impl BoxSide {
    const MAX: i32 = 16;
}

impl TryFrom<i64> for BoxSide {
    type Error = String;

    fn try_from(cells: i64) -> Result<Self, String> {
        match i32::try_from(cells) {
            Ok(cells @ 1..=Self::MAX) => Ok(Self(cells)),
            _ => Err(format!("{cells} is out of range: 1 to {} cells", Self::MAX)),
        }
    }
}

impl From<BoxSide> for i64 {
    fn from(side: BoxSide) -> Self {
        Self::from(side.0)
    }
}

const fn one() -> BoxSide {
    BoxSide(1)
}

const fn two() -> BoxSide {
    BoxSide(2)
}

/// Returns the cells where a path outside starts: the blocks of a material, or the centre of the bounding box.
pub(super) fn starts(structure: &Structure, bounds: &Bounds, start_material: Option<&str>) -> Vec<Cell> {
    match start_material.filter(|material| !material.is_empty()) {
        Some(material) => structure.cells_of(|name| contains_lower(name, material)),
        None => vec![bounds.centre()],
    }
}

fn exit_finding(subject: &Subject<'_>, size: [i32; 3], start_material: Option<&str>) -> Result<Finding, Stopped> {
    let [width, depth, height] = size;
    let required: Value = subject.tell(|| json!({ "exit": { "width": width, "depth": depth, "height": height } }));
    let structure = subject.structure;
    let Some(bounds) = structure.bounds() else {
        return Ok(Finding::nothing_stands(true, required));
    };
    let starts = starts(structure, &bounds, start_material);
    if starts.is_empty() {
        let summary =
            subject.tell(|| format!("no block matches {:?}: no exit is required", start_material.unwrap_or_default()));
        return Ok(Finding::binary(true, json!(null), required, summary).vacuous_if(true));
    }
    let solid = structure.cells_of(|name| !contains_lower(name, "door") && !contains_lower(name, "bed"));
    let beside = |start: &Cell| std::iter::once(*start).chain(start.side_neighbours());
    let escapes = |x: i32, z: i32| {
        let space = FreeSpace::new(&solid, &bounds, BoxSize { x, y: height, z });
        space.escapes(starts.iter().flat_map(beside), &|| (subject.control.stop)()).ok_or(Stopped)
    };
    let holds = escapes(width, depth)? || (width != depth && escapes(depth, width)?);
    let summary = subject.tell(|| {
        format!(
            "a box {width} wide, {depth} deep and {height} high {} out",
            if holds { "gets" } else { "does not get" }
        )
    });
    let finding = Finding::binary(holds, holds, required, summary);
    Ok(if holds { finding } else { finding.with_witnesses(starts, "start") })
}
