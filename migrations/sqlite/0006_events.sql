-- What happened, in the order in which it became durable, for those who follow it live and come back after a break: the
-- ends of submissions and of runs, each written in the transaction that ends them.
CREATE TABLE events (
    id            INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    at_ms         INTEGER NOT NULL,
    run_id        TEXT    REFERENCES runs (id),
    submission_id TEXT    REFERENCES submissions (id),   -- null: the run itself
    state         TEXT    NOT NULL,                      -- the state in which it ended
    overall       INTEGER,                               -- verdict of a graded submission
    CHECK (run_id IS NOT NULL OR submission_id IS NOT NULL)
) STRICT;
CREATE INDEX events_of_run ON events (run_id, id) WHERE run_id IS NOT NULL;
CREATE INDEX events_of_submission ON events (submission_id) WHERE submission_id IS NOT NULL;
