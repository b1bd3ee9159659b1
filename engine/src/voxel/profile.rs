//! Rules under which the actions of an agent become a build.

use serde::{Deserialize, Serialize};

/// Rules under which action code is replayed and events are applied (`docs/rules.md#replay`).
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, utoipa::ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// As the published pipeline has it: code sees an empty world, and a removal only reaches blocks of earlier turns.
    #[default]
    Published,
    /// As a bot of the mindcraft framework acts in a game with cheats on: code sees a world, and events count in their
    /// true order.
    Mindcraft,
}

impl Profile {
    /// All profiles.
    pub const ALL: [Self; 2] = [Self::Published, Self::Mindcraft];

    /// Returns the name of the profile.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Published => "published",
            Self::Mindcraft => "mindcraft",
        }
    }

    /// Returns the profile of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }

    /// Returns whether this is [`Profile::Published`], which stored forms leave out.
    #[must_use]
    pub fn is_published(&self) -> bool {
        *self == Self::Published
    }
}

impl std::fmt::Display for Profile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
