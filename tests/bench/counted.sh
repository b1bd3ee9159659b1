#!/usr/bin/env bash
# Counts the instructions of hot paths, and fails if one differs by more than 5 % from the table: tests/bench/counted.sh [--accept].
set -euo pipefail
cd "$(dirname "$0")/../.."
cargo build --locked --bin plumbline --example counted
built=${CARGO_TARGET_DIR:-$PWD/target}/debug
exec "$built/examples/counted" check "$built/plumbline" "$@"
