#!/usr/bin/env bash
# A trainer: rewards for what a model wrote, for one log and for a batch. Nothing is stored.
set -euo pipefail
cd "$(dirname "$0")/.."
server=${PLUMBLINE:-http://localhost:7586}

curl -sf -H 'content-type: application/json' "$server/v1/grade" --data-binary @examples/answer.json
echo

# A line for each log; results stream back as they are ready, each with its index.
for file in examples/wall.json examples/answer.json; do tr -d '\n' < "$file"; echo; done |
    curl -sfN -H 'content-type: application/x-ndjson' "$server/v1/grade:batch" --data-binary @-
