#!/usr/bin/env bash
# An agent's author: begins a run, submits an answer, reads its report, finishes the run and reads the board.
set -euo pipefail
cd "$(dirname "$0")/.."
server=${PLUMBLINE_SERVER:-http://localhost:7586}
# Faults are shown; a key is sent if there is one.
curl() { command curl -sS --fail-with-body ${PLUMBLINE_KEY:+-H "authorization: Bearer $PLUMBLINE_KEY"} "$@"; }
json='content-type: application/json'
id() { sed -E 's/.*"id": ?"([^"]+)".*/\1/'; }

# What there is to build.
curl "$server/v1/tasks?suite=mineceraft&limit=2"
echo

run=$(curl -H "$json" "$server/v1/runs" -d '{"agent": "my-agent 1", "suite": "mineceraft"}' | id)
submission=$(sed "1a \"run\": \"$run\"," examples/wall.json | curl -H "$json" "$server/v1/submissions" --data-binary @- | id)

# Queued, grading, graded.
while curl "$server/v1/submissions/$submission" | grep -E '"state":"(queued|grading)"' > /dev/null; do sleep 0.2; done
curl "$server/v1/submissions/$submission/report"
echo

# No more answers will come; the other tasks are left out on purpose and count as failed.
curl -H "$json" "$server/v1/runs/$run/finish" -d '{"skip": "unanswered"}' > /dev/null
while curl "$server/v1/runs/$run" | grep '"state":"finishing"' > /dev/null; do sleep 0.2; done
curl "$server/v1/leaderboards/mineceraft?format=csv"
