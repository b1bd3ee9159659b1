-- Suites, tasks, runs, submissions, jobs and reports.
-- Times are integer milliseconds since 1970 (UTC). JSON is text. Ids are UUIDs (version 7) as text.

-- A suite under a name and a version. Never changes once it is here.
CREATE TABLE suites (
    id            TEXT    NOT NULL PRIMARY KEY,          -- name@version
    name          TEXT    NOT NULL,
    version       INTEGER NOT NULL,
    task_count    INTEGER NOT NULL,
    content_hash  TEXT    NOT NULL,                      -- over the hashes of its tasks, in order
    created_at_ms INTEGER NOT NULL,
    UNIQUE (name, version)
) STRICT;

-- A task by the SHA-256 of its content. Suites share tasks.
CREATE TABLE tasks (
    hash   TEXT    NOT NULL PRIMARY KEY,
    id     TEXT    NOT NULL,                             -- family/instance
    family TEXT    NOT NULL,
    body   TEXT    NOT NULL                              -- the task as JSON
) STRICT;

CREATE TABLE suite_tasks (
    suite_id  TEXT    NOT NULL REFERENCES suites (id),
    number    INTEGER NOT NULL,                          -- the run_idx of published records
    task_hash TEXT    NOT NULL REFERENCES tasks (hash),
    PRIMARY KEY (suite_id, number)
) STRICT;

-- One agent's attempt at a suite. The counters change in the transaction that changes a submission's state.
CREATE TABLE runs (
    id             TEXT    NOT NULL PRIMARY KEY,
    agent          TEXT    NOT NULL,
    suite_id       TEXT    NOT NULL REFERENCES suites (id),
    metadata       TEXT    NOT NULL,
    state          TEXT    NOT NULL CHECK (state IN ('open', 'finishing', 'finished')),
    pending        INTEGER NOT NULL DEFAULT 0,           -- submissions queued or being graded
    graded         INTEGER NOT NULL DEFAULT 0,
    grader_errors  INTEGER NOT NULL DEFAULT 0,           -- ended by a failure of ours and not posted again
    created_at_ms  INTEGER NOT NULL,
    finished_at_ms INTEGER,
    summary        TEXT,                                 -- set when finished
    CHECK ((state = 'finished') = (summary IS NOT NULL)),
    CHECK ((state = 'finished') = (finished_at_ms IS NOT NULL))
) STRICT;
CREATE INDEX runs_by_suite ON runs (suite_id, state, finished_at_ms);

-- What an agent did for one task. The log is immutable.
CREATE TABLE submissions (
    id            TEXT    NOT NULL PRIMARY KEY,
    run_id        TEXT    REFERENCES runs (id),
    suite_id      TEXT    NOT NULL REFERENCES suites (id),
    task_hash     TEXT    NOT NULL REFERENCES tasks (hash),
    task_number   INTEGER NOT NULL,
    log_hash      TEXT    NOT NULL,                      -- SHA-256 of the canonical JSON of the log
    log           BLOB    NOT NULL,                      -- that JSON, zstd
    log_bytes     INTEGER NOT NULL,                      -- its size before compression
    turns         INTEGER NOT NULL,
    events        INTEGER NOT NULL,
    state         TEXT    NOT NULL
        CHECK (state IN ('queued', 'grading', 'graded', 'rejected', 'grader_error', 'cancelled')),
    error         TEXT,                                  -- why it ended without a report, for the client
    superseded    INTEGER NOT NULL DEFAULT 0,            -- 1: ended by a failure of ours and posted again
    created_at_ms INTEGER NOT NULL,
    ended_at_ms   INTEGER
) STRICT;
-- A run holds one live submission a task.
CREATE UNIQUE INDEX submissions_one_per_task ON submissions (run_id, task_number)
    WHERE run_id IS NOT NULL AND superseded = 0;
CREATE INDEX submissions_not_ended ON submissions (created_at_ms) WHERE ended_at_ms IS NULL;

-- Work to do: one row per submission that has not ended.
CREATE TABLE jobs (
    submission_id  TEXT    NOT NULL PRIMARY KEY REFERENCES submissions (id),
    queued_at_ms   INTEGER NOT NULL,
    attempt        INTEGER NOT NULL DEFAULT 0,           -- the fencing token: results of older attempts are refused
    lease_until_ms INTEGER NOT NULL DEFAULT 0            -- 0: free
) STRICT;
CREATE INDEX jobs_by_age ON jobs (queued_at_ms, submission_id);

-- What grading found. Grading again adds a row; the latest attempt counts.
CREATE TABLE reports (
    submission_id  TEXT    NOT NULL REFERENCES submissions (id),
    attempt        INTEGER NOT NULL,
    checks_version INTEGER NOT NULL,
    grader         TEXT    NOT NULL,                     -- name and version of the program
    overall        INTEGER NOT NULL,
    accuracy       INTEGER,
    scores         TEXT    NOT NULL,                     -- criterion and score per check, for summaries
    body           BLOB    NOT NULL,                     -- the report as JSON, zstd
    graded_at_ms   INTEGER NOT NULL,
    grading_us     INTEGER NOT NULL,
    PRIMARY KEY (submission_id, attempt)
) STRICT;
