//! Crashes, full disks, copies, old files, and several nodes on one server.

mod across_nodes;
mod blobs;
mod blobs_unmounted;
mod copies;
mod crash;
mod crash_faults;
mod crash_matrix;
mod each_write;
mod failures;
mod faults;
mod full_disk;
mod held_lock;
mod lost_file;
mod network;
mod nodes;
mod postgres;
mod rolling;
mod scene;
mod soak;
mod store_model;
mod upgrade;
mod webhooks_across_nodes;
