-- What owners may submit and have submitted. A submission is one unit: reserved when it is accepted, charged when what
-- grading found is released, refunded where it ends without that. Every change is a row with its reason, written in the
-- transaction of what caused it; the sums stand in quotas, so that deciding takes one row.
CREATE TABLE quotas (
    owner    TEXT    NOT NULL PRIMARY KEY,
    granted  INTEGER,                                    -- null: as much as they like
    reserved INTEGER NOT NULL DEFAULT 0,
    charged  INTEGER NOT NULL DEFAULT 0,
    CHECK (reserved >= 0 AND charged >= 0)
) STRICT;
CREATE TABLE quota_entries (
    id            INTEGER NOT NULL PRIMARY KEY,
    owner         TEXT    NOT NULL REFERENCES quotas (owner),
    submission_id TEXT    REFERENCES submissions (id),   -- null: a grant
    kind          TEXT    NOT NULL CHECK (kind IN ('grant', 'reserve', 'charge', 'refund')),
    units         INTEGER NOT NULL,
    reason        TEXT    NOT NULL,
    at_ms         INTEGER NOT NULL,
    CHECK ((kind = 'grant') = (submission_id IS NULL))
) STRICT;
CREATE INDEX quota_entries_by_owner ON quota_entries (owner, id);
-- A submission is charged or refunded, and once.
CREATE UNIQUE INDEX quota_settled_once ON quota_entries (submission_id) WHERE kind IN ('charge', 'refund');

-- What waits already.
INSERT INTO quotas (owner, reserved)
    SELECT owner, COUNT(*) FROM submissions WHERE owner IS NOT NULL AND ended_at_ms IS NULL GROUP BY owner;
INSERT INTO quota_entries (owner, submission_id, kind, units, reason, at_ms)
    SELECT owner, id, 'reserve', 1, 'accepted before quotas were kept', created_at_ms
    FROM submissions WHERE owner IS NOT NULL AND ended_at_ms IS NULL;
