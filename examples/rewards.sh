#!/usr/bin/env bash
# A trainer: rewards for what a model wrote, for one log and for a batch. Nothing is stored.
set -euo pipefail
cd "$(dirname "$0")/.."
server=${PLUMBLINE_SERVER:-http://localhost:7586}
# Faults are shown; a key is sent if there is one.
curl() { command curl -sS --fail-with-body ${PLUMBLINE_KEY:+-H "authorization: Bearer $PLUMBLINE_KEY"} "$@"; }

curl -H 'content-type: application/json' "$server/v1/grade" --data-binary @examples/answer.json
echo

# A line for each log; results stream back as they are ready, each with its index.
for file in examples/wall.json examples/answer.json; do tr -d '\n' < "$file"; echo; done |
    curl -N -H 'content-type: application/x-ndjson' "$server/v1/grade:batch" --data-binary @-
