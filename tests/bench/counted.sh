#!/usr/bin/env bash
# Counts the instructions of hot paths, and fails if one differs by more than 5 % from the table: tests/bench/counted.sh [--accept].
set -euo pipefail
cd "$(dirname "$0")/../.."
# What the tests are built with: `cargo build` has other features of crates, builds everything anew, and counts otherwise.
cargo test --locked --no-run
built=${CARGO_TARGET_DIR:-$PWD/target}/debug
exec "$built/examples/counted" check "$built/plumbline" "$@"
