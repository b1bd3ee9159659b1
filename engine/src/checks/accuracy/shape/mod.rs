//! Shape: the published rules for clusters, surfaces, rooms, doors, exits, symmetry and stairs, and our own strict
//! rules in `arch`, `ceilings`, `columns`, `enclosed`, `level`, `spans`, `vaults` and `ways`
//! (`docs/rules.md#strict-rules`).

pub mod arch;
pub mod ceilings;
pub mod clusters;
pub mod columns;
pub mod doors;
pub mod enclosed;
pub mod exits;
pub mod level;
pub mod rooms;
pub mod single_level;
pub mod spans;
pub mod stairs;
pub mod surfaces;
pub mod symmetry;
pub mod vaults;
pub mod ways;

/// Returns whether an argument has its default, which serialised forms leave out.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
pub(super) const fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// Returns whether a name contains another when both are in lower case, which is how shape checks compare names.
pub(super) fn contains_lower(name: &str, wanted: &str) -> bool {
    name.to_lowercase().contains(&wanted.to_lowercase())
}

/// Returns whether a block with this name counts as a door.
pub(super) fn is_door(name: &str) -> bool {
    name.to_lowercase().contains("door")
}
