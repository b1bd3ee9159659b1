#!/usr/bin/env bash
# Load on the build for production, client and server on the same cores: bash tests/bench/load.sh [SECONDS]
# Needs wrk (Debian: wrk). Prints offered and achieved rate, latencies, errors, ratios of medians, and the server's memory.
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=${1:-10}
command -v wrk >/dev/null || { echo "load.sh: wrk is missing (Debian: apt-get install wrk)"; exit 1; }
cargo build --profile dist --features jemalloc --quiet --bins --examples
built=${CARGO_TARGET_DIR:-target}/dist
program=$built/plumbline
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
    printf '%-46s' "$1" | tee -a "$work/rates"
    BODIES=${BODIES:-$work/bodies} LOAD_PATH=$2 CONNECTIONS=$3 \
        wrk --threads 1 --connections "$3" --duration "${seconds}s" --timeout 30s --script tests/bench/load.lua "http://127.0.0.1:${PORT:-8099}" |
        grep '^offered' | tee -a "$work/rates"
}
median() { # of the logs a second of all loads whose names begin so
    grep "^$1" "$work/rates" | sed 's/.*(\([0-9]*\) logs.*/\1/' | sort -n | awk '{ at[NR] = $1 } END { print at[int((NR + 1) / 2)] }'
}
ratio() { # what it says, two names
    awk -v name="$1" -v one="$(median "$2")" -v other="$(median "$3")" 'BEGIN { printf "%-46s%.2f\n", name, one / other }'
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
start --workers 0
load "accepted alone, durable, one a POST" /v1/submissions 256
start
begun=$(date +%s%N)
load "submitted, durable, one a POST" /v1/submissions 256
memory
metric() { curl -s localhost:8099/metrics | awk -v name="^$1" '$0 ~ name { sum += $2 } END { print sum + 0 }'; }
accepted=$(metric 'plumbline_http_requests_total.*status="202"')
until [ "$(metric plumbline_graded_total)" -ge "$accepted" ]; do
    kill -0 "$server" && [ $(($(date +%s%N) - begun)) -lt 300000000000 ] || { echo "load.sh: not all of $accepted submissions were graded"; exit 1; }
    sleep 0.05
done
took_ms=$((($(date +%s%N) - begun) / 1000000))
echo "submitted, graded and signed: $accepted in $took_ms ms, $((accepted * 1000 / took_ms))/s; accepted alone $(median 'accepted alone')/s"
# A board with rows, and the same bytes from a bare axum route, in turn.
"$program" submit tests/conformance/run.jsonl --agent load --server http://127.0.0.1:8099 >/dev/null 2>&1
board=/v1/leaderboards/mineceraft@1
"$built"/examples/bare_route 127.0.0.1:8098 "http://127.0.0.1:8099$board" &
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
RATE=$(($(median 'grade, cache off, round') / 2)) load "grade at half of that" /v1/grade 32
ratio "a board / bare" "a board, round" "the same bytes, bare, round"
ratio "grade / bare" "grade, cache off, round" "the same bodies, bare, round"
ratio "a batch / grade" "batch of 100, round" "grade, cache off, round"
# Ten thousand connections that send nothing, a thousand whose bodies trickle, and how others are served meanwhile.
start
ulimit -n "$(ulimit -Hn)"
"$built"/examples/slow_clients 127.0.0.1:8099 10000 1000 15
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
