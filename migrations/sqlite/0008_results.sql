-- What finished runs came to. A run that is graded again gets another row; the last holds, and a board as of an earlier time
-- shows the one that held then.
CREATE TABLE results (
    id         INTEGER NOT NULL PRIMARY KEY,             -- grows: what is new since a board was read has a greater one
    run_id     TEXT    NOT NULL REFERENCES runs (id),
    since_ms   INTEGER NOT NULL,
    summary    TEXT    NOT NULL,
    outcomes   BLOB                                      -- per task of the suite what passes, two bytes; null: see the reports
) STRICT;
CREATE INDEX results_of_run ON results (run_id, id);
INSERT INTO results (run_id, since_ms, summary)
    SELECT id, finished_at_ms, summary FROM runs WHERE state = 'finished' ORDER BY finished_at_ms, id;

-- What was done to rows of boards by people: public, and for ever.
CREATE TABLE board_actions (
    id      INTEGER NOT NULL PRIMARY KEY,
    run_id  TEXT    NOT NULL REFERENCES runs (id),
    action  TEXT    NOT NULL CHECK (action IN ('hide', 'restore', 'regrade')),
    actor   TEXT    NOT NULL,
    reason  TEXT    NOT NULL,
    at_ms   INTEGER NOT NULL
) STRICT;
CREATE INDEX board_actions_of_run ON board_actions (run_id, id);
CREATE TRIGGER board_actions_stay BEFORE DELETE ON board_actions
    BEGIN SELECT RAISE(ABORT, 'entries about boards are permanent'); END;
CREATE TRIGGER board_actions_stand BEFORE UPDATE ON board_actions
    BEGIN SELECT RAISE(ABORT, 'entries about boards are permanent'); END;

-- Grading again with another version of the checks: computed beside what holds, then applied or discarded as a whole.
CREATE TABLE regrades (
    id              TEXT    NOT NULL PRIMARY KEY,
    suite_id        TEXT    NOT NULL REFERENCES suites (id),
    reason          TEXT    NOT NULL,
    actor           TEXT    NOT NULL,
    checks_version  INTEGER NOT NULL,
    grader          TEXT    NOT NULL,
    state           TEXT    NOT NULL CHECK (state IN ('computing', 'ready', 'applied', 'discarded')),
    created_at_ms   INTEGER NOT NULL,
    ended_at_ms     INTEGER
) STRICT;
CREATE TABLE regraded (
    regrade_id    TEXT    NOT NULL REFERENCES regrades (id),
    submission_id TEXT    NOT NULL REFERENCES submissions (id),
    overall       INTEGER NOT NULL,
    accuracy      INTEGER,
    scores        TEXT    NOT NULL,
    body          BLOB    NOT NULL,
    grading_us    INTEGER NOT NULL,
    PRIMARY KEY (regrade_id, submission_id)
) STRICT;
