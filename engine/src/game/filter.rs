//! Blocks to which a command is limited.

use super::registry::StateId;
use super::tags;

/// Blocks that a command is limited to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Filter {
    /// The blocks.
    pub members: Members,
    /// Values of properties that they must have.
    pub wanted: Vec<(String, String)>,
}

/// Blocks by number or by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Members {
    /// The block of this number.
    Block(u16),
    /// The blocks that the patterns of a tag describe.
    Tag(&'static [&'static str]),
}

impl Filter {
    /// Returns whether the filter accepts a state.
    #[must_use]
    pub fn accepts(&self, state: StateId) -> bool {
        let block = state.block();
        let is_member = match self.members {
            Members::Block(number) => block.number == number,
            Members::Tag(patterns) => tags::has(patterns, block.name),
        };
        is_member && self.wanted.iter().all(|(name, value)| state.get(name) == Some(value.as_str()))
    }
}
