//! Names that blocks had in older versions of the game, which files keep.

use serde::{Deserialize as _, Deserializer};

use super::states::State;
use super::{FileError, FileResult};

/// First version of the game's data in which blocks have names and states, of a snapshot of 1.13.
const FIRST: i32 = 1_451;

/// Old names, new names, and the first version of the data that has the new one: 1.14, 1.17 and 1.20.3.
const RENAMED: [(&str, &str, i32); 5] = [
    ("stone_slab", "smooth_stone_slab", 1_952),
    ("sign", "oak_sign", 1_952),
    ("wall_sign", "oak_wall_sign", 1_952),
    ("grass_path", "dirt_path", 2_724),
    ("grass", "short_grass", 3_698),
];

/// Reads the version of the data from a file. One that is no whole number is as good as none.
///
/// # Errors
/// Returns an error if the value is not NBT.
pub fn data_version<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<i32>, D::Error> {
    let value = fastnbt::Value::deserialize(deserializer)?;
    Ok(value.as_i64().and_then(|version| version.try_into().ok()))
}

/// Names of blocks in the version of the game that a file was written for. Without a version they are those of today.
#[derive(Debug, Clone, Copy, Default)]
pub struct Names(Option<i32>);

impl Names {
    /// # Errors
    /// Returns an error for a version in which blocks have numbers.
    pub fn of(data_version: Option<i32>) -> FileResult<Self> {
        match data_version {
            Some(old) if (1..FIRST).contains(&old) => Err(FileError::new(format!(
                "DataVersion: {old} is older than Minecraft 1.13; load the build in a newer version of the game and save it anew"
            ))),
            // Some programs write -1 or 0 for a version that they do not know.
            _ => Ok(Self(data_version.filter(|version| *version > 0))),
        }
    }

    /// Returns a block state by its name of today.
    pub fn now(self, state: &State) -> State {
        let bare = state.name.strip_prefix("minecraft:").unwrap_or(&state.name);
        let renamed = |(old, _, since): &&(&str, &str, i32)| *old == bare && self.0.is_some_and(|own| own < *since);
        let name = RENAMED.iter().find(renamed).map_or(state.name.clone(), |(_, new, _)| (*new).to_owned());
        State { name, properties: state.properties.clone() }
    }
}
