-- What happened in hidden evaluation, signed at once and entered into the log of receipts at fixed times, so that the log does not
-- tell when an answer was graded.
CREATE TABLE pending_receipts (
    id            INTEGER NOT NULL PRIMARY KEY,
    epoch_id      TEXT    NOT NULL REFERENCES epochs (id),
    submission_id TEXT    REFERENCES submissions (id),   -- of a grade
    attempt       INTEGER,
    body          TEXT    NOT NULL,                      -- canonical JSON
    hash          TEXT    NOT NULL,
    signature     TEXT    NOT NULL,
    public_key    TEXT    NOT NULL
) STRICT;
CREATE INDEX receipts_of_epoch ON receipts (epoch_id, seq) WHERE epoch_id IS NOT NULL;

-- Null for epochs made before, which keep the rules of then.
ALTER TABLE epochs ADD COLUMN owner_runs INTEGER;       -- runs that one owner may hold, drawn or reserved
ALTER TABLE epochs ADD COLUMN reservation_ms INTEGER;   -- how long a run that is not drawn keeps its part of the pool
ALTER TABLE epochs ADD COLUMN settled_at_ms INTEGER;    -- over, all answers graded, all receipts entered

-- The receipts that the owner was given: signed, as JSON.
ALTER TABLE entries ADD COLUMN receipt TEXT;
ALTER TABLE instances ADD COLUMN receipt TEXT;
