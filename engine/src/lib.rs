//! The grading engine of plumbline: from what an agent did to the report on what it built.
//!
//! Everything here is a pure function of its input. No room reads a clock, draws random numbers, starts a thread, writes a log, or
//! opens a file or a connection, and nothing fails because of what an agent built. The one error that grading knows is
//! [`elasticity::Stopped`], when the caller asks a long simulation to end.
//!
//! Rooms import only those above them in this list; `tests/tidy` enforces it.

pub mod voxel;

pub mod intake;

pub mod elasticity;

pub mod checks;

pub mod tasks;

pub mod builders;

pub mod grading;

pub mod hidden;
