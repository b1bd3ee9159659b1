#!/usr/bin/env bash
# An operator: a database, keys, quotas, a backup and an epoch of hidden evaluation, in a folder of its own.
set -euo pipefail
# A program that is given by its path is still found from the new folder.
plumbline=$(realpath "$(command -v "${PLUMBLINE_PROGRAM:-plumbline}")")
cd "$(mktemp -d)"
export PLUMBLINE_DATABASE=plumbline.db

"$plumbline" migrate --create

# The key is shown once. Requests send it as `Authorization: Bearer plk_…`.
key=$("$plumbline" keys create --name my-lab --scopes submit,grade --expires 90d)
"$plumbline" keys rotate "$(cut -d_ -f2 <<< "$key")" --overlap 24
"$plumbline" quota grant --name my-lab --submissions 10000 --reason 'autumn trial'

# It opens in a week and lasts a month.
opens=$(date -u -d '+7 days' +%Y-%m-%dT00:00:00Z)
closes=$(date -u -d '+37 days' +%Y-%m-%dT00:00:00Z)
"$plumbline" epochs create autumn --opens "$opens" --closes "$closes" --per-instance 2
"$plumbline" epochs list

"$plumbline" backup plumbline-backup.db
"$plumbline" restore plumbline-backup.db --dry-run --database restored.db
