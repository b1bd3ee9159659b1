//! The grading engine of plumbline: turns the log of an agent's actions into a report on what the agent built.
//!
//! Everything here is a pure function of its input. No module reads a clock, draws random numbers, starts a thread,
//! writes a log, or opens a file or a connection. Nothing fails because of what an agent built: the only error that
//! grading returns is [`elasticity::Stopped`], when the caller asks a long simulation to end.
//!
//! Each module imports only the modules above it in this list; `tests/tidy` enforces this.

pub mod text;

pub mod voxel;

pub mod game;

pub mod intake;

pub mod elasticity;

pub mod checks;

pub mod tasks;

pub mod builders;

pub mod grading;

pub mod hidden;
