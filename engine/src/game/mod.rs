//! A small Minecraft world: flat ground, the blocks on it, and the commands that change them, as a vanilla server of
//! version 1.21.4 carries them out.
//!
//! `docs/rules.md#mindcraft` says what is simulated and what is not.

pub mod command;
pub mod coordinates;
mod falling;
mod filter;
pub mod labels;
mod placing;
mod reading;
mod refusal;
mod region;
pub mod registry;
mod search;
mod server;
mod shapes;
pub mod side;
mod support;
mod tags;
mod words;
pub mod world;

pub use reading::MAX_CHARS as MAX_COMMAND_CHARS;
pub use search::{MAX_DISTANCE, MAX_FOUND};

pub use refusal::Refusal;
pub use registry::{Block, Look, StateId};
pub use side::Side;
pub use world::World;
