//! Action code: scripts that agents wrote, and scripts that mean harm.

mod answers;
mod contract;
mod others;
mod scripts;
