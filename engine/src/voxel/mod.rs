//! Voxels: cells, block logs, the structure that stands after each turn, and its geometry.
//!
//! This room is pure: no clock, thread, randomness, file or network, and it imports no other room.
//! No algorithm here allocates by the extent of a build: two blocks a million cells apart cost two blocks. (`terrain` does,
//! and takes small builds only.)

pub mod block_log;
pub mod blocks;
pub mod cell;
pub mod connectivity;
pub mod distance;
pub mod free_space;
pub mod palette;
pub mod planar;
pub mod replay;
pub mod rooms;
pub mod structure;
pub mod surface;
pub mod terrain;

pub use block_log::{BlockLog, Event, Turn};
pub use cell::{Bounds, Cell, CellMap, CellSet};
pub use palette::{MaterialId, Palette};
pub use structure::Structure;
