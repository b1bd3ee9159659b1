//! Suites and tasks.

mod own_suites;
mod tasks;
