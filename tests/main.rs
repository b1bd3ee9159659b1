//! The integration tests, in one binary. Its folders follow those of `src/http`; beside them stand `durability`,
//! `conformance`, `browser`, `cli`, `actions`, `fuzz`, `load`, `docs` and `tidy`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod accounts;
mod actions;
mod boards;
mod browser;
mod catalogue;
mod cli;
mod conformance;
mod docs;
mod durability;
mod episodes;
mod fuzz;
mod hidden;
mod load;
mod rewards;
mod service;
mod submissions;
mod support;
mod tidy;
