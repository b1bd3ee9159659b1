-- The log of receipts also says when the key that signs them changed: an entry that belongs to no submission. SQLite cannot take a
-- NOT NULL off a column, so the table is made anew with the same rows.
CREATE TABLE receipts_with_keys (
    seq           INTEGER NOT NULL PRIMARY KEY,
    submission_id TEXT    REFERENCES submissions (id),   -- null: the key changed
    attempt       INTEGER,
    epoch_id      TEXT    REFERENCES epochs (id),        -- of a hidden instance: the body is released when it is over
    body          TEXT    NOT NULL,                      -- canonical JSON
    hash          TEXT    NOT NULL,
    signature     TEXT    NOT NULL,
    public_key    TEXT    NOT NULL,
    previous      TEXT    NOT NULL,
    link          TEXT    NOT NULL,
    CHECK ((submission_id IS NULL) = (attempt IS NULL))
) STRICT;
INSERT INTO receipts_with_keys
    SELECT seq, submission_id, attempt, epoch_id, body, hash, signature, public_key, previous, link FROM receipts;
DROP TRIGGER receipts_stay;
DROP TRIGGER receipts_stand;
DROP TABLE receipts;
ALTER TABLE receipts_with_keys RENAME TO receipts;
CREATE INDEX receipts_by_key ON receipts (public_key, seq);
CREATE UNIQUE INDEX receipts_of_submission ON receipts (submission_id, attempt);
CREATE TRIGGER receipts_stay BEFORE DELETE ON receipts BEGIN SELECT RAISE(ABORT, 'receipts are permanent'); END;
CREATE TRIGGER receipts_stand BEFORE UPDATE ON receipts BEGIN SELECT RAISE(ABORT, 'receipts are permanent'); END;
