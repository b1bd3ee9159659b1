#!/usr/bin/env bash
# An operator: a database, keys, quotas, a backup and an epoch of hidden evaluation, in a folder of its own.
set -euo pipefail
plumbline=${PLUMBLINE_PROGRAM:-plumbline}
export PLUMBLINE_DATABASE=${PLUMBLINE_DATABASE:-plumbline.db}

"$plumbline" migrate --create

# The key is shown once. Requests send it as `Authorization: Bearer plk_…`.
key=$("$plumbline" keys create --name my-lab --scopes submit,grade --expires 90d)
"$plumbline" keys rotate "$(cut -d_ -f2 <<< "$key")" --overlap 24
"$plumbline" quota grant --name my-lab --submissions 10000 --reason 'autumn trial'

"$plumbline" epochs create 2026-12 --opens 2026-12-01T00:00:00Z --closes 2027-01-01T00:00:00Z --per-instance 2
"$plumbline" epochs list

"$plumbline" backup plumbline-backup.db
"$plumbline" restore plumbline-backup.db --dry-run --database restored.db
