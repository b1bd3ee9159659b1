//! Schemas of the forms of a log, for the contract of whoever accepts logs.
//!
//! The readers beside this file write events straight into a block log, so no value of these types ever exists.

use crate::voxel::Profile;

/// A turn: plain events, a palette and rows, action code, or a structure file.
#[derive(Debug, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTurn {
    /// Events, in order.
    pub events: Option<Vec<NewEvent>>,
    /// Compact form: names of the materials that `rows` refer to.
    pub palette: Option<Vec<String>>,
    /// Compact form: `[x, y, z, i]` places a block of palette entry i, `[x, y, z]` removes one.
    pub rows: Option<Vec<Vec<i32>>>,
    /// Instead of events: JavaScript as agents of the mindcraft framework write it, bare or in a code fence; a list if
    /// the turn has several files, which run in order. The service runs it; the blocks that it places and removes are
    /// the events.
    pub action_code: Option<ActionCode>,
    /// Instead of events: a structure file in base64 (`.nbt`, `.schem` or `.litematic`), which holds all that stands
    /// after the turn. The order of its blocks is unknown.
    #[schema(content_encoding = "base64")]
    pub structure: Option<String>,
    /// Where the least corner of the structure's box goes: `[x, y, z]`. By default where a paste at (0, 0, 0) puts it.
    #[schema(min_items = 3, max_items = 3)]
    pub corner: Option<Vec<i32>>,
}

/// Action code of a turn: one text, or several files.
#[derive(Debug, utoipa::ToSchema)]
#[schema(as = ActionCode)]
#[serde(untagged)]
pub enum ActionCode {
    /// The answer or file.
    One(String),
    /// Files, in the order in which they run.
    Several(Vec<String>),
}

/// An event: a block that is placed or removed.
#[derive(Debug, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewEvent {
    /// `place` or `remove`.
    #[schema(example = "place")]
    pub action: EventAction,
    /// Coordinate to the east.
    pub x: i32,
    /// Coordinate upwards; the ground surface is y <= 0.
    pub y: i32,
    /// Coordinate to the south.
    pub z: i32,
    /// Name of the material; required for `place`.
    #[schema(example = "stone")]
    pub material: Option<String>,
}

/// Action on a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventAction {
    /// A block is placed.
    Place,
    /// A block is removed.
    Remove,
}

/// A log in the stored form.
#[derive(Debug, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "palette": ["stone"], "turns": [[[0, 0, 0, 0]]] }))]
pub struct StoredLogBody {
    /// Names of materials.
    pub palette: Vec<String>,
    /// Rows of each turn: `[x, y, z, i]` places a block of palette entry i, `[x, y, z]` removes one.
    pub turns: Vec<Vec<Vec<i32>>>,
    /// Rules under which the events become a build; `published` if absent.
    pub profile: Option<Profile>,
}
