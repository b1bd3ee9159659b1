//! Plumbline grades what AI agents build as construction engineers in Minecraft (the MineCEraft benchmark).
//!
//! The rooms and what each may import are described in docs/architecture.md; `tests/tidy.rs` enforces it.

pub mod actions;
pub mod app;
pub mod cli;
pub mod client;
pub mod clock;
pub mod fair;
pub mod http;
pub mod near;
pub mod startup;
pub mod store;
pub mod telemetry;
pub mod threads;
pub mod worker;
