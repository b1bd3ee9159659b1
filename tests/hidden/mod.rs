//! Hidden evaluation: entries, attacks and leaks.

mod attacks;
mod evaluation;
mod leaks;
