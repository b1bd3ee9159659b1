#!/usr/bin/env bash
# Both databases on one machine: submissions a second, and the time of one on an idle service.
# bash tests/bench/nodes.sh POSTGRES-URL [SECONDS]; the database of the URL must be empty. Needs wrk (Debian: wrk).
set -euo pipefail
cd "$(dirname "$0")/../.."
url=$1 seconds=${2:-8}
[ -n "${PROGRAM:-}" ] || cargo build --profile dist --features jemalloc --quiet --bin plumbline
program=${PROGRAM:-target/dist/plumbline}
work=$(mktemp -d)
nodes=()
stop() { for node in "${nodes[@]}"; do kill "$node" 2>/dev/null || true; done; wait 2>/dev/null || true; nodes=(); }
trap 'stop; rm -rf "$work"' EXIT
export RUST_LOG=warn PLUMBLINE_SECRETS=$work/secrets
start() { # database, processes
    stop
    "$program" serve --open --workers 1 --listen 127.0.0.1:8099 --database "$1" 2>"$work/log" &
    nodes+=($!)
    until curl -sf localhost:8099/readyz >/dev/null; do sleep 0.1; done
    if [ "$2" = 2 ]; then
        "$program" work --workers 1 --listen 127.0.0.1:8097 --database "$1" 2>"$work/log2" &
        nodes+=($!)
        until curl -sf localhost:8097/readyz >/dev/null; do sleep 0.1; done
    fi
}
waiting() { curl -s localhost:8099/metrics | awk '/^plumbline_submissions_not_ended/ { print $2 }'; }
"$program" build --all 100 300 | grep -v -e '"task":"[a-z]*-layer-roofs' -e '"task":"stressed' >"$work/bodies"
export BODIES=$work/bodies
for database in "$work/p.db" "$url"; do
    for processes in 1 2; do
        start "$database" "$processes"
        printf '%-10s %d process(es): ' "${database%%:*}" "$processes" | sed "s|$work/||"
        begun=$(date +%s.%N)
        LOAD_PATH=/v1/submissions CONNECTIONS=128 wrk --threads 1 --connections 128 --duration "${seconds}s" --timeout 30s \
            --script tests/bench/load.lua http://127.0.0.1:8099 | grep '^offered' | sed 's/^/accepted, /' | tr '\n' ' '
        left=$(waiting)
        while [ "$(waiting)" != 0 ]; do sleep 0.1; done
        ended=$(date +%s.%N)
        echo "; $left waited at the end, all graded after $(echo "$ended - $begun" | bc) s"
    done
    start "$database" 1
    python3 - "$work/bodies" <<'PYTHON'
import json, statistics, sys, time, urllib.request
bodies = open(sys.argv[1]).read().splitlines()
times = []
for i in range(200):
    body = bodies[i % len(bodies)].encode()
    begun = time.perf_counter()
    request = urllib.request.Request("http://127.0.0.1:8099/v1/submissions", body, {"content-type": "application/json"})
    path = json.load(urllib.request.urlopen(request))["id"]
    while json.load(urllib.request.urlopen(f"http://127.0.0.1:8099/v1/submissions/{path}"))["state"] != "graded":
        pass
    times.append((time.perf_counter() - begun) * 1000)
    time.sleep(0.02)
times.sort()
print(f"  one on an idle service, posted until graded: p50 {statistics.median(times):.1f} ms, p95 {times[189]:.1f} ms")
PYTHON
done
