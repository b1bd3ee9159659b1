#!/usr/bin/env bash
# An agent that builds step by step: it looks at what stands, goes on, and submits.
set -euo pipefail
server=${PLUMBLINE_SERVER:-http://localhost:7586}
# Faults are shown; a key is sent if there is one.
curl() { command curl -sS --fail-with-body ${PLUMBLINE_KEY:+-H "authorization: Bearer $PLUMBLINE_KEY"} "$@"; }
post() { curl -H 'content-type: application/json' "$server$1" --data "$2"; }
member() { python3 -c 'import json, sys; print(json.load(sys.stdin)[sys.argv[1]])' "$1"; }

episode=/v1/episodes/$(post /v1/episodes '{"task": "walls/5x1x5-raise"}' | member id)
curl "$server$episode" | member prompt

# The number of the step makes it safe to send a request again.
post "$episode/steps" '{"step": 1, "action_code": "for (let x = 0; x < 5; x++)\n  await skills.placeBlock(bot, \"stone\", x, 0, 0);"}'
echo
curl "$server$episode/view?from=-1,-1,-1&to=5,1,1"
echo
curl "$server$episode/picture?from=south-east" --output "${PICTURE:-/dev/null}"
post "$episode/submit" '{}'
echo
