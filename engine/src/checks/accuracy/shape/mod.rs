//! Shape: clusters, surfaces, rooms, doors, ways out, symmetry and stairs. `enclosed`, `ways`, `spans` and `vaults` are strict
//! rules of our own, for hidden suites (SPEC 7).

pub mod arch;
pub mod clusters;
pub mod doors;
pub mod enclosed;
pub mod exits;
pub mod rooms;
pub mod single_level;
pub mod spans;
pub mod stairs;
pub mod surfaces;
pub mod symmetry;
pub mod vaults;
pub mod ways;

/// Whether a name contains another when both are lower-cased: how shape checks compare.
pub(super) fn contains_lower(name: &str, wanted: &str) -> bool {
    name.to_lowercase().contains(&wanted.to_lowercase())
}

/// Whether a block counts as a door.
pub(super) fn is_door(name: &str) -> bool {
    name.to_lowercase().contains("door")
}
