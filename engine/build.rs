//! Rebuilds when a task file is added: the engine carries them.

fn main() {
    println!("cargo:rerun-if-changed=../tasks");
}
