//! Hidden evaluation: entries, attacks and leaks.

mod attacks;
mod draws;
mod evaluation;
mod leaks;
mod log;
