//! Hidden evaluation: entries, attacks and leaks.

mod announcements;
mod archive;
mod attacks;
mod beacons;
mod draws;
mod evaluation;
mod fields;
mod leaks;
mod log;
mod log_trouble;
mod mishaps;
mod siblings;
