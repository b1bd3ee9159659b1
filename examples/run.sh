#!/usr/bin/env bash
# An agent's author: begins a run, submits an answer, reads its report, finishes the run and reads the board.
set -euo pipefail
cd "$(dirname "$0")/.."
server=${PLUMBLINE:-http://localhost:7586}
json='content-type: application/json'
id() { sed -E 's/.*"id": ?"([^"]+)".*/\1/'; }

# What there is to build.
curl -sf "$server/v1/tasks?suite=mineceraft-lite&limit=2"
echo

run=$(curl -sf -H "$json" "$server/v1/runs" -d '{"agent": "my-agent 1", "suite": "mineceraft"}' | id)
submission=$(sed "1a \"run\": \"$run\"," examples/wall.json | curl -sf -H "$json" "$server/v1/submissions" --data-binary @- | id)

# Queued, grading, graded.
until curl -sf "$server/v1/submissions/$submission" | grep -q '"state":"graded"'; do sleep 0.2; done
curl -sf "$server/v1/submissions/$submission/report"
echo

# No more answers will come; the other tasks are left out on purpose and count as failed.
curl -sf -H "$json" "$server/v1/runs/$run/finish" -d '{"skip": "unanswered"}' > /dev/null
until curl -sf "$server/v1/runs/$run" | grep -q '"state":"finished"'; do sleep 0.2; done
curl -sf "$server/v1/leaderboards/mineceraft?format=csv"
