//! Episodes: an attempt at a task, turn by turn, in a world that the service keeps.
//!
//! `open` begins one, `step` runs code or applies events, `turns` goes on to the next turn and submits what was built.
//! Each step is stored before it is answered, so an episode survives a restart of the service.

pub mod body;
pub mod open;
pub mod state;
pub mod step;
pub mod turns;
pub mod view;
