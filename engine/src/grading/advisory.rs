//! The form of an advisory.

use serde::{Deserialize, Serialize};

/// A warning about a graded structure or one of its checks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Advisory {
    /// Kind of the advisory: a stable code, for programs.
    pub code: AdvisoryCode,
    /// Turn that it concerns, from 1.
    pub turn: u32,
    /// Check that it concerns, as an index into the turn's checks, from 0; absent if it concerns the whole structure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub check: Option<u32>,
    /// Description of the advisory, for people.
    pub detail: String,
}

impl Advisory {
    /// Returns the memory that the advisory takes, in bytes.
    #[must_use]
    pub const fn heap_bytes(&self) -> usize {
        size_of::<Self>() + self.detail.capacity()
    }
}

/// Kind of an advisory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AdvisoryCode {
    /// The structure has no blocks.
    EmptyStructure,
    /// A check passed only because there was nothing to check.
    HeldVacuously,
    /// The stress that a check measured is unreliable or undefined.
    UnreliableStress,
    /// The stress in equilibrium, shown for comparison, is incomplete.
    IncompleteEquilibrium,
    /// The structure lists a cell more than once.
    RepeatedCell,
    /// Air was placed as a block.
    AirPlaced,
    /// Names have the `minecraft:` prefix, which exact comparisons do not strip.
    NamespacedNames,
    /// Every block is at y <= 0. Not told where `shape.level_has` asks for blocks there and all checks of the turn hold.
    EntirelyInGround,
    /// A required material was matched only as part of other blocks' names.
    LookalikeMaterial,
    /// A name is not that of a block of the game.
    UnknownBlock,
    /// A removal in the turn that placed the block does nothing under the profile `published`.
    RemovalWithoutEffect,
    /// A removal in the turn that placed the block, which counts under `mindcraft` and would do nothing under
    /// `published`.
    DiffersFromPublished,
}
