//! Crashes, full disks, copies, old files, and several nodes on one server.

mod copies;
mod crash;
mod crash_matrix;
mod faults;
mod full_disk;
mod held_lock;
mod nodes;
mod postgres;
mod store_model;
mod upgrade;
