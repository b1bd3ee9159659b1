//! Voxels: cells, block logs, the structure that stands after each turn, and the geometry of structures.
//!
//! This module is pure: it uses no clock, thread, randomness, file or network, and imports no other module. Except in
//! `terrain`, which accepts small builds only, memory use does not depend on the extent of a build: two blocks that are
//! a million cells apart cost as much as any two blocks.

mod air_runs;
pub mod block_log;
pub mod blocks;
pub mod cell;
pub mod connectivity;
pub mod distance;
pub mod free_space;
pub mod inside;
pub mod palette;
pub mod planar;
pub mod profile;
pub mod reading;
pub mod replay;
pub mod rooms;
pub mod structure;
pub mod surface;
pub mod terrain;

pub use block_log::{BlockLog, Event, Turn};
pub use cell::{Bounds, Cell, CellMap, CellSet};
pub use palette::{MaterialId, Palette};
pub use profile::Profile;
pub use reading::Reading;
pub use structure::Structure;
