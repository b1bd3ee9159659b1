#!/usr/bin/env bash
# Load on the build for production, client and server on the same cores: bash tests/bench/load.sh [SECONDS]
# Needs wrk (Debian: wrk). Prints offered and achieved rate, latencies, errors, and the server's memory.
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=${1:-10}
command -v wrk >/dev/null || { echo "load.sh: wrk is missing (Debian: apt-get install wrk)"; exit 1; }
cargo build --profile dist --features jemalloc --quiet --bins --examples
program=target/dist/plumbline
work=$(mktemp -d)
server=
stop() { if [ -n "$server" ]; then kill "$server" 2>/dev/null || true; wait "$server" 2>/dev/null || true; fi; server=; }
trap 'stop; rm -rf "$work"' EXIT
start() { # arguments of serve
    stop
    rm -rf "$work"/p.db*
    # Without a line a request, which the figures in README.md were measured without too.
    RUST_LOG=info,plumbline::request=warn "$program" serve --open --listen 127.0.0.1:8099 --database "$work/p.db" "$@" 2>"$work/log" &
    server=$!
    until curl -sf localhost:8099/healthz >/dev/null; do sleep 0.1; done
}
memory() { awk '/VmRSS|VmHWM/ { printf "%s %d MiB  ", $1, $2 / 1024 } END { print "" }' "/proc/$server/status"; }
load() { # name, path, connections; settings in the environment
    printf '%-46s' "$1"
    BODIES=${BODIES:-$work/bodies} LOAD_PATH=$2 CONNECTIONS=$3 \
        wrk --threads 1 --connections "$3" --duration "${seconds}s" --timeout 30s --script tests/bench/load.lua "http://127.0.0.1:${PORT:-8099}" |
        grep '^offered'
}

# Builds of 100 to 300 events without a stress check.
"$program" build --all 100 300 | grep -v -e '"task":"[a-z]*-layer-roofs' -e '"task":"stressed' >"$work/bodies"
echo "$(wc -l <"$work/bodies") logs of 100 to 300 events, $(($(wc -c <"$work/bodies") / $(wc -l <"$work/bodies"))) bytes each"

start --grade-cache-mib 0
load "grade, cache off" /v1/grade 32
RATE=4000 load "grade, cache off, half the goal" /v1/grade 32
CHUNK=100 KIND=application/x-ndjson load "grade:batch of 100, cache off" /v1/grade:batch 8
memory
start
load "grade, cache on" /v1/grade 32
memory
start
load "submit, durable, one a POST" /v1/submissions 256
memory
graded() { curl -s localhost:8099/metrics | awk '/^plumbline_graded_total/ { print $2 }'; }
before=$(graded); sleep 2; after=$(graded)
echo "graded since the start: ${after:-0}; in the 2 s after: $((${after:-0} - ${before:-0}))"
# A board with rows, and the same bytes from a bare axum route, in turn.
"$program" submit tests/conformance/run.jsonl --agent load --server http://127.0.0.1:8099 >/dev/null 2>&1
board=/v1/leaderboards/mineceraft@1
target/dist/examples/bare_route 127.0.0.1:8098 "http://127.0.0.1:8099$board" &
bare=$!
sleep 0.5
for round in 1 2 3; do
    METHOD=GET load "a board, round $round" "$board" 32
    METHOD=GET PORT=8098 load "the same bytes, bare, round $round" / 32
done
# Grades, and the same bodies read into typed turns by a bare axum route, in turn.
start --grade-cache-mib 0
for round in 1 2 3; do
    load "grade, cache off, round $round" /v1/grade 32
    CHUNK=100 KIND=application/x-ndjson load "batch of 100, round $round" /v1/grade:batch 8
    PORT=8098 load "the same bodies, bare, round $round" /grade 32
done
kill "$bare"
memory
# Ten thousand connections that send nothing, a thousand whose bodies trickle, and how others are served meanwhile.
start
ulimit -n "$(ulimit -Hn)"
target/dist/examples/slow_clients 127.0.0.1:8099 10000 1000 15
memory
# Sixteen thousand at once.
load "grade, 16,000 connections" /v1/grade 16000 &
sleep $((seconds / 2))
curl -s -o /dev/null -w 'a board meanwhile, on a new connection: %{time_total} s\n' "localhost:8099$board"
wait %% 2>/dev/null || true
memory
# A million gradings and more: what memory does.
start --grade-cache-mib 0
seconds=3 CHUNK=100 KIND=application/x-ndjson load "warm up" /v1/grade:batch 8
memory
seconds=${SOAK:-60} CHUNK=100 KIND=application/x-ndjson load "grade:batch, ${SOAK:-60} s" /v1/grade:batch 8
memory
