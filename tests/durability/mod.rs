//! Crashes, full disks, copies and old files.

mod copies;
mod crash;
mod crash_matrix;
mod full_disk;
mod held_lock;
mod upgrade;
