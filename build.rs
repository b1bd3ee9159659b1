//! Rebuilds when a migration or a task file is added: the binary carries them.

fn main() {
    println!("cargo:rerun-if-changed=migrations");
    println!("cargo:rerun-if-changed=tasks");
}
