-- Hidden evaluation: epochs, what is registered in them, the instances that they issue, and receipts of all grades. Keys and
-- specifications that were not issued are not here but in files beside the database, so no copy of it gives them away.
CREATE TABLE epochs (
    id                  TEXT    NOT NULL PRIMARY KEY,
    commitment          TEXT    NOT NULL,                -- as published, JSON
    opens_at_ms         INTEGER NOT NULL,
    closes_at_ms        INTEGER NOT NULL,
    instance_ms         INTEGER NOT NULL,                -- how long an instance may be answered
    dev_entries         INTEGER NOT NULL,                -- entries of an owner, by tier
    official_entries    INTEGER NOT NULL,
    budget_bits         REAL    NOT NULL,                -- information that may be released while it is open
    released_bits       REAL    NOT NULL DEFAULT 0,
    created_at_ms       INTEGER NOT NULL,
    closed_at_ms        INTEGER,                         -- null: it closes at its time
    closed_reason       TEXT,
    CHECK ((closed_at_ms IS NULL) = (closed_reason IS NULL))
) STRICT;

-- Registered before anything is seen.
CREATE TABLE entries (
    id                 TEXT    NOT NULL PRIMARY KEY,
    epoch_id           TEXT    NOT NULL REFERENCES epochs (id),
    owner              TEXT    NOT NULL,                 -- '' where the service was open to everybody
    agent              TEXT    NOT NULL,
    configuration_hash TEXT    NOT NULL,
    tier               TEXT    NOT NULL CHECK (tier IN ('dev', 'official')),
    runs               INTEGER NOT NULL,
    registered_at_ms   INTEGER NOT NULL,
    finalized_at_ms    INTEGER,                          -- no more answers; what has none counts as failed
    completed_at_ms    INTEGER                           -- and all answers are graded
) STRICT;
CREATE INDEX entries_of_epoch ON entries (epoch_id, tier, owner);

-- A specification issued to an entry. No specification of an epoch is issued twice.
CREATE TABLE instances (
    id                    TEXT    NOT NULL PRIMARY KEY,
    entry_id              TEXT    NOT NULL REFERENCES entries (id),
    epoch_id              TEXT    NOT NULL REFERENCES epochs (id),
    ordinal               INTEGER NOT NULL,              -- place in the order of issue
    run                   INTEGER NOT NULL,
    family                TEXT    NOT NULL,
    family_index          INTEGER NOT NULL,
    nonce                 TEXT    NOT NULL,
    leaf                  INTEGER NOT NULL,
    task_hash             TEXT    NOT NULL REFERENCES tasks (hash),
    issued_at_ms          INTEGER NOT NULL,
    expires_at_ms         INTEGER NOT NULL,
    salt                  TEXT    NOT NULL,              -- of its receipt
    transcript_hash       TEXT,                          -- promised with the answer
    transcript_checked_ms INTEGER,
    UNIQUE (epoch_id, leaf),
    UNIQUE (epoch_id, ordinal),
    UNIQUE (entry_id, run, family, family_index)
) STRICT;

-- An answer to an instance is a submission that nobody is shown before the epoch is over.
ALTER TABLE submissions ADD COLUMN instance_id TEXT REFERENCES instances (id);
CREATE UNIQUE INDEX submissions_one_per_instance ON submissions (instance_id) WHERE instance_id IS NOT NULL AND superseded = 0;

-- Receipts of grades, signed, each linked to the one before: a public log.
CREATE TABLE receipts (
    seq           INTEGER NOT NULL PRIMARY KEY,
    submission_id TEXT    NOT NULL REFERENCES submissions (id),
    attempt       INTEGER NOT NULL,
    epoch_id      TEXT    REFERENCES epochs (id),        -- of a hidden instance: the body is released when it is over
    body          TEXT    NOT NULL,                      -- canonical JSON
    hash          TEXT    NOT NULL,
    signature     TEXT    NOT NULL,
    public_key    TEXT    NOT NULL,
    previous      TEXT    NOT NULL,
    link          TEXT    NOT NULL
) STRICT;
CREATE INDEX receipts_by_key ON receipts (public_key, seq);
CREATE UNIQUE INDEX receipts_of_submission ON receipts (submission_id, attempt);
CREATE TRIGGER receipts_stay BEFORE DELETE ON receipts BEGIN SELECT RAISE(ABORT, 'receipts are permanent'); END;
CREATE TRIGGER receipts_stand BEFORE UPDATE ON receipts BEGIN SELECT RAISE(ABORT, 'receipts are permanent'); END;

-- What is known of how a run came about, beside what its owner says.
ALTER TABLE runs ADD COLUMN provenance TEXT NOT NULL DEFAULT 'self-reported';
