//! Plumbline grades the builds of AI agents that act as construction engineers in Minecraft (the MineCEraft benchmark).
//!
//! docs/architecture.md describes the modules and what each may import; `tests/tidy` enforces it.

pub mod actions;
pub mod app;
pub mod cli;
pub mod client;
pub mod clock;
pub mod fair;
pub mod formats;
pub mod http;
pub mod pictures;
pub mod startup;
pub mod store;
pub mod telemetry;
pub mod threads;
pub mod tls;
pub mod worker;
