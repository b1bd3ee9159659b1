-- Attempts at a task, or at a hidden instance, whose code acts step by step in a world that the service keeps. A row is
-- written with each step, before the step is answered.
CREATE TABLE episodes (
    id              TEXT    NOT NULL PRIMARY KEY,
    owner           TEXT,                                  -- null: opened without a key
    suite_id        TEXT,                                  -- of a task of a suite
    task_number     INTEGER,
    run_id          TEXT,
    instance_id     TEXT    REFERENCES instances (id),     -- of a hidden instance
    created_at_ms   INTEGER NOT NULL,
    expires_at_ms   INTEGER NOT NULL,
    step            INTEGER NOT NULL,                      -- number of the last step, from 1; 0 before the first
    state           BLOB    NOT NULL,                      -- turn, log, world and last answer as JSON, packed with zstd
    submitting_at_ms INTEGER,                            -- no more steps: what is built is being submitted
    submitted_at_ms INTEGER,
    submission_id   TEXT,                                  -- null for a hidden instance
    CHECK ((suite_id IS NULL) = (task_number IS NULL)),
    CHECK ((suite_id IS NULL) <> (instance_id IS NULL))
) STRICT;
CREATE INDEX episodes_by_owner ON episodes (owner, expires_at_ms) WHERE submitted_at_ms IS NULL;
CREATE INDEX episodes_by_age ON episodes (expires_at_ms);
