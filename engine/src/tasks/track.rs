//! Tracks of prompts: the same task, asked for in full or in short.

use serde::{Deserialize, Serialize};

/// Wording of the prompts that an agent is given.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, utoipa::ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Track {
    /// The prompt states every condition that is measured.
    #[default]
    Specified,
    /// The prompt asks in a sentence or two, as the paper does, and takes the conventions of the suite's preamble for
    /// granted.
    Brief,
}

impl Track {
    /// All tracks.
    pub const ALL: [Self; 2] = [Self::Specified, Self::Brief];

    /// Returns the name of the track.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Specified => "specified",
            Self::Brief => "brief",
        }
    }

    /// Returns the track of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|track| track.name() == name)
    }
}
