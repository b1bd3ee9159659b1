-- The tables of plumbline on PostgreSQL: the same tables and columns as the migrations for SQLite give.
--
-- Times are integer milliseconds since 1970 (UTC). JSON is text, as it was hashed or signed. Ids are UUIDs as text.
-- Texts that are compared or sorted have the collation "C", so that every server sorts them alike.
-- Tables that change row by row leave room in their pages (fillfactor) and are vacuumed early.

-- The time of the server. Leases count by it, because the clocks of nodes differ.
CREATE FUNCTION now_ms() RETURNS BIGINT LANGUAGE sql STABLE AS
    $$ SELECT (EXTRACT(EPOCH FROM statement_timestamp()) * 1000)::BIGINT $$;

-- A suite under a name and a version. It never changes.
CREATE TABLE suites (
    id            TEXT   COLLATE "C" NOT NULL PRIMARY KEY,  -- name@version
    name          TEXT   COLLATE "C" NOT NULL,
    version       BIGINT NOT NULL,
    task_count    BIGINT NOT NULL,
    content_hash  TEXT   NOT NULL,                          -- over the hashes of its tasks, in order
    created_at_ms BIGINT NOT NULL,
    UNIQUE (name, version)
);

-- A task by the SHA-256 of its content. Suites share tasks.
CREATE TABLE tasks (
    hash   TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    id     TEXT COLLATE "C" NOT NULL,                       -- family/instance
    family TEXT COLLATE "C" NOT NULL,
    body   TEXT NOT NULL                                    -- the task as JSON
);

CREATE TABLE suite_tasks (
    suite_id  TEXT   COLLATE "C" NOT NULL REFERENCES suites (id),
    number    BIGINT NOT NULL,                              -- run_idx of published records
    task_hash TEXT   COLLATE "C" NOT NULL REFERENCES tasks (hash),
    PRIMARY KEY (suite_id, number)
);

-- An agent's attempt at a suite. The counters change in the transaction that changes a submission's state.
CREATE TABLE runs (
    id             TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    seq            BIGINT GENERATED ALWAYS AS IDENTITY UNIQUE,  -- in the order of commits
    agent          TEXT   COLLATE "C" NOT NULL,
    suite_id       TEXT   COLLATE "C" NOT NULL REFERENCES suites (id),
    metadata       TEXT   NOT NULL,
    state          TEXT   NOT NULL CHECK (state IN ('open', 'finishing', 'finished')),
    pending        BIGINT NOT NULL DEFAULT 0,               -- submissions queued or being graded
    graded         BIGINT NOT NULL DEFAULT 0,
    grader_errors  BIGINT NOT NULL DEFAULT 0,               -- ended by a failure of ours and not posted again
    created_at_ms  BIGINT NOT NULL,
    finished_at_ms BIGINT,
    summary        TEXT,                                    -- set when finished
    owner          TEXT   COLLATE "C",                      -- null where the service was open to everybody
    provenance     TEXT   NOT NULL DEFAULT 'self-reported',
    deleted_at_ms  BIGINT,                                  -- its owner deleted it while it was open
    CHECK ((state = 'finished') = (summary IS NOT NULL)),
    CHECK ((state = 'finished') = (finished_at_ms IS NOT NULL)),
    CHECK (pending >= 0 AND graded >= 0 AND grader_errors >= 0)
) WITH (fillfactor = 70);
CREATE INDEX runs_by_suite ON runs (suite_id, state, finished_at_ms);
CREATE INDEX runs_by_owner ON runs (owner, created_at_ms);
CREATE INDEX runs_by_age ON runs (created_at_ms);

-- Tasks of a run that its owner leaves out on purpose: they count as failed, and as covered.
CREATE TABLE skipped_tasks (
    run_id      TEXT   COLLATE "C" NOT NULL REFERENCES runs (id),
    task_number BIGINT NOT NULL,
    PRIMARY KEY (run_id, task_number)
);

-- Hidden evaluation: epochs, what is registered in them, and the instances that they issue. Keys, and specifications that
-- were not issued, are not here but in the folder of secrets.
CREATE TABLE epochs (
    id               TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    commitment       TEXT   NOT NULL,                       -- as published, JSON
    opens_at_ms      BIGINT NOT NULL,
    closes_at_ms     BIGINT NOT NULL,
    instance_ms      BIGINT NOT NULL,                       -- how long an instance may be answered
    dev_entries      BIGINT NOT NULL,                       -- entries of an owner, by tier
    official_entries BIGINT NOT NULL,
    budget_bits      DOUBLE PRECISION NOT NULL,             -- information that may be released while it is open
    released_bits    DOUBLE PRECISION NOT NULL DEFAULT 0,
    created_at_ms    BIGINT NOT NULL,
    closed_at_ms     BIGINT,                                -- null: it closes at its time
    closed_reason    TEXT,
    owner_runs       BIGINT,                                -- runs that one owner may hold, drawn or reserved
    reservation_ms   BIGINT,                                -- how long a run that is not drawn keeps its part of the pool
    settled_at_ms    BIGINT,                                -- over, all answers graded, all receipts entered
    CHECK ((closed_at_ms IS NULL) = (closed_reason IS NULL))
);

-- Registered before anything is seen.
CREATE TABLE entries (
    id                 TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    epoch_id           TEXT   COLLATE "C" NOT NULL REFERENCES epochs (id),
    owner              TEXT   COLLATE "C" NOT NULL,         -- '' where the service was open to everybody
    agent              TEXT   NOT NULL,
    configuration_hash TEXT   NOT NULL,
    tier               TEXT   NOT NULL CHECK (tier IN ('dev', 'official')),
    runs               BIGINT NOT NULL,
    registered_at_ms   BIGINT NOT NULL,
    finalized_at_ms    BIGINT,                              -- no more answers; what has none counts as failed
    completed_at_ms    BIGINT,                              -- and all answers are graded
    receipt            TEXT                                 -- as its owner was given it: signed, JSON
);
CREATE INDEX entries_of_epoch ON entries (epoch_id, tier, owner);

-- A specification issued to an entry. No specification of an epoch is issued twice.
CREATE TABLE instances (
    id                    TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    entry_id              TEXT   COLLATE "C" NOT NULL REFERENCES entries (id),
    epoch_id              TEXT   COLLATE "C" NOT NULL REFERENCES epochs (id),
    ordinal               BIGINT NOT NULL,                  -- position in the order of issue
    run                   BIGINT NOT NULL,
    family                TEXT   COLLATE "C" NOT NULL,
    family_index          BIGINT NOT NULL,
    nonce                 TEXT   NOT NULL,
    leaf                  BIGINT NOT NULL,
    task_hash             TEXT   COLLATE "C" NOT NULL REFERENCES tasks (hash),
    issued_at_ms          BIGINT NOT NULL,
    expires_at_ms         BIGINT NOT NULL,
    salt                  TEXT   NOT NULL,                  -- of its receipt
    transcript_hash       TEXT,                             -- promised with the answer
    transcript_checked_ms BIGINT,
    receipt               TEXT,                             -- of the answer, as its owner was given it: signed, JSON
    UNIQUE (epoch_id, leaf),
    UNIQUE (epoch_id, ordinal),
    UNIQUE (entry_id, run, family, family_index)
);

-- What an agent did for one task. The log is immutable.
CREATE TABLE submissions (
    id            TEXT    COLLATE "C" NOT NULL PRIMARY KEY,
    run_id        TEXT    COLLATE "C" REFERENCES runs (id),
    suite_id      TEXT    COLLATE "C" NOT NULL REFERENCES suites (id),
    task_hash     TEXT    COLLATE "C" NOT NULL REFERENCES tasks (hash),
    task_number   BIGINT  NOT NULL,
    log_hash      TEXT    NOT NULL,                         -- SHA-256 of the canonical JSON of the log
    log           BYTEA   NOT NULL,                         -- that JSON, zstd
    log_bytes     BIGINT  NOT NULL,                         -- its size before compression
    turns         BIGINT  NOT NULL,
    events        BIGINT  NOT NULL,
    state         TEXT    NOT NULL
        CHECK (state IN ('queued', 'grading', 'graded', 'rejected', 'grader_error', 'cancelled')),
    error         TEXT,                                     -- why it ended without a report, for the client
    superseded    BOOLEAN NOT NULL DEFAULT FALSE,           -- ended without a grade, and posted again
    created_at_ms BIGINT  NOT NULL,
    ended_at_ms   BIGINT,
    owner         TEXT    COLLATE "C",                      -- null where the service was open to everybody
    replays       TEXT,                                     -- what its action code did beside its events, JSON
    instance_id   TEXT    COLLATE "C" REFERENCES instances (id)  -- it answers this; nobody is shown it before the epoch is over
) WITH (fillfactor = 70);
-- The log is compressed already.
ALTER TABLE submissions ALTER COLUMN log SET STORAGE EXTERNAL;
-- A run holds one answer a task, and an instance one.
CREATE UNIQUE INDEX submissions_one_per_task ON submissions (run_id, task_number)
    WHERE run_id IS NOT NULL AND superseded = FALSE;
CREATE UNIQUE INDEX submissions_one_per_instance ON submissions (instance_id)
    WHERE instance_id IS NOT NULL AND superseded = FALSE;
CREATE INDEX submissions_not_ended ON submissions (created_at_ms) WHERE ended_at_ms IS NULL;

-- Work to do: a row for each submission that has not ended. Rounds (`turn`) serve the owners of a lane alternately.
CREATE TABLE jobs (
    submission_id  TEXT   COLLATE "C" NOT NULL PRIMARY KEY REFERENCES submissions (id),
    queued_at_ms   BIGINT NOT NULL,
    attempt        BIGINT NOT NULL DEFAULT 0,               -- the fencing token: results of older attempts are refused
    lease_until_ms BIGINT NOT NULL DEFAULT 0,               -- 0: free
    lease_ms       BIGINT NOT NULL DEFAULT 0,               -- length of the lease
    lane           TEXT   COLLATE "C" NOT NULL DEFAULT 'long' CHECK (lane IN ('quick', 'long', 'hidden')),
    owner          TEXT   COLLATE "C" NOT NULL DEFAULT '',  -- '' where the service was open to everybody
    turn           BIGINT NOT NULL DEFAULT 0
) WITH (fillfactor = 50, autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 1000,
        autovacuum_vacuum_cost_delay = 0);
CREATE INDEX jobs_by_turn ON jobs (lane, turn, queued_at_ms, submission_id);
CREATE INDEX jobs_of_owner ON jobs (lane, owner, turn);

-- Lanes of the queue, with the greatest round of which a job was taken. It never falls.
CREATE TABLE lanes (
    name TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    turn BIGINT NOT NULL
) WITH (fillfactor = 10, autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 100);
INSERT INTO lanes (name, turn) VALUES ('quick', 0), ('long', 0), ('hidden', 0);

-- What grading found. Grading again adds a row; the latest attempt counts.
CREATE TABLE reports (
    submission_id  TEXT    COLLATE "C" NOT NULL REFERENCES submissions (id),
    attempt        BIGINT  NOT NULL,
    checks_version BIGINT  NOT NULL,
    grader         TEXT    NOT NULL,                        -- name and version of the program
    overall        BOOLEAN NOT NULL,
    accuracy       BOOLEAN,
    scores         TEXT    NOT NULL,                        -- criterion and score per check, for summaries
    body           BYTEA   NOT NULL,                        -- the report as JSON, zstd
    graded_at_ms   BIGINT  NOT NULL,
    grading_us     BIGINT  NOT NULL,
    fingerprint    BYTEA,                                   -- sketch of the build, to find near-identical runs
    PRIMARY KEY (submission_id, attempt)
);
ALTER TABLE reports ALTER COLUMN body SET STORAGE EXTERNAL;

-- What finished runs came to. A run that is graded again gets another row; the last holds.
CREATE TABLE results (
    id          BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY,  -- in the order of commits
    run_id      TEXT   COLLATE "C" NOT NULL REFERENCES runs (id),
    since_ms    BIGINT NOT NULL,
    summary     TEXT   NOT NULL,
    outcomes    BYTEA,                                      -- two bytes for each task of the suite
    fingerprint BYTEA
);
CREATE INDEX results_of_run ON results (run_id, id);

-- The ends of submissions and runs, in the order of commits.
CREATE TABLE events (
    id            BIGINT  GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    at_ms         BIGINT  NOT NULL,
    run_id        TEXT    COLLATE "C" REFERENCES runs (id),
    submission_id TEXT    COLLATE "C" REFERENCES submissions (id),  -- null: the run itself
    state         TEXT    NOT NULL,                         -- the state in which it ended
    overall       BOOLEAN,                                  -- verdict of a graded submission
    CHECK (run_id IS NOT NULL OR submission_id IS NOT NULL)
);
CREATE INDEX events_of_run ON events (run_id, id) WHERE run_id IS NOT NULL;
CREATE INDEX events_of_submission ON events (submission_id) WHERE submission_id IS NOT NULL;

-- What people did to rows of boards: public and permanent.
CREATE TABLE board_actions (
    id     BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY,  -- in the order of commits
    run_id TEXT   COLLATE "C" NOT NULL REFERENCES runs (id),
    action TEXT   NOT NULL CHECK (action IN ('hide', 'restore', 'regrade')),
    actor  TEXT   NOT NULL,
    reason TEXT   NOT NULL,
    at_ms  BIGINT NOT NULL
);
CREATE INDEX board_actions_of_run ON board_actions (run_id, id);

-- Grading again with another version of the checks: computed beside what holds, then applied or discarded as a whole.
CREATE TABLE regrades (
    id             TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    suite_id       TEXT   COLLATE "C" NOT NULL REFERENCES suites (id),
    reason         TEXT   NOT NULL,
    actor          TEXT   NOT NULL,
    checks_version BIGINT NOT NULL,
    grader         TEXT   NOT NULL,
    state          TEXT   NOT NULL CHECK (state IN ('computing', 'ready', 'applied', 'discarded')),
    created_at_ms  BIGINT NOT NULL,
    ended_at_ms    BIGINT
);
CREATE TABLE regraded (
    regrade_id    TEXT    COLLATE "C" NOT NULL REFERENCES regrades (id),
    submission_id TEXT    COLLATE "C" NOT NULL REFERENCES submissions (id),
    overall       BOOLEAN NOT NULL,
    accuracy      BOOLEAN,
    scores        TEXT    NOT NULL,
    body          BYTEA   NOT NULL,
    grading_us    BIGINT  NOT NULL,
    PRIMARY KEY (regrade_id, submission_id)
);

-- API keys. Of a key only the hash of its secret is kept.
CREATE TABLE keys (
    id              TEXT   COLLATE "C" NOT NULL PRIMARY KEY,  -- the public part of the key
    owner           TEXT   COLLATE "C" NOT NULL,
    secret_hash     TEXT   NOT NULL,                          -- SHA-256 of the secret part, in hex
    scopes          TEXT   NOT NULL,                          -- submit,grade,read,admin: those it has, by commas
    created_at_ms   BIGINT NOT NULL,
    expires_at_ms   BIGINT,
    revoked_at_ms   BIGINT,
    last_used_at_ms BIGINT                                    -- to the minute
) WITH (fillfactor = 70);
CREATE INDEX keys_by_owner ON keys (owner);

-- Results of requests with an Idempotency-Key, written in the transaction of their effect. Kept for 24 hours.
CREATE TABLE idempotency (
    owner         TEXT   COLLATE "C" NOT NULL,              -- '' where the service was open to everybody
    key           TEXT   COLLATE "C" NOT NULL,
    body_hash     TEXT   NOT NULL,                          -- SHA-256 over operation and body, in hex
    result        TEXT   NOT NULL,                          -- what the answer is made from, as JSON
    created_at_ms BIGINT NOT NULL,
    PRIMARY KEY (owner, key)
);
CREATE INDEX idempotency_by_age ON idempotency (created_at_ms);

-- What owners may submit and have submitted: every change is a row of the ledger, and the sums stand in quotas.
CREATE TABLE quotas (
    owner       TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    granted     BIGINT,                                     -- null: no limit
    reserved    BIGINT NOT NULL DEFAULT 0,
    charged     BIGINT NOT NULL DEFAULT 0,
    used_before BIGINT NOT NULL DEFAULT 0,                  -- use before the first grant, which does not count
    CHECK (reserved >= 0 AND charged >= 0)
) WITH (fillfactor = 50);
CREATE TABLE quota_entries (
    id            BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY,
    owner         TEXT   COLLATE "C" NOT NULL REFERENCES quotas (owner),
    submission_id TEXT   COLLATE "C" REFERENCES submissions (id),  -- null: a grant
    kind          TEXT   NOT NULL CHECK (kind IN ('grant', 'reserve', 'charge', 'refund')),
    units         BIGINT NOT NULL,
    reason        TEXT   NOT NULL,
    at_ms         BIGINT NOT NULL,
    CHECK ((kind = 'grant') = (submission_id IS NULL))
);
CREATE INDEX quota_entries_by_owner ON quota_entries (owner, id);
-- A submission is charged or refunded, and once.
CREATE UNIQUE INDEX quota_settled_once ON quota_entries (submission_id) WHERE kind IN ('charge', 'refund');

-- Receipts of grades and of changes of the key, signed, each linked to the one before: a public log.
CREATE TABLE receipts (
    seq           BIGINT NOT NULL PRIMARY KEY,
    submission_id TEXT   COLLATE "C" REFERENCES submissions (id),  -- null: the key changed, or hidden evaluation
    attempt       BIGINT,
    epoch_id      TEXT   COLLATE "C" REFERENCES epochs (id),       -- the body is released when this epoch is over
    body          TEXT   NOT NULL,                                 -- canonical JSON
    hash          TEXT   COLLATE "C" NOT NULL,
    signature     TEXT   NOT NULL,
    public_key    TEXT   COLLATE "C" NOT NULL,
    previous      TEXT   NOT NULL,
    link          TEXT   NOT NULL,
    CHECK ((submission_id IS NULL) = (attempt IS NULL))
);
CREATE INDEX receipts_by_key ON receipts (public_key, seq);
CREATE UNIQUE INDEX receipts_of_submission ON receipts (submission_id, attempt);
CREATE INDEX receipts_of_epoch ON receipts (epoch_id, seq) WHERE epoch_id IS NOT NULL;

-- Receipts of hidden evaluation: signed at once, and entered into the log at fixed times.
CREATE TABLE pending_receipts (
    id            BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    epoch_id      TEXT   COLLATE "C" NOT NULL REFERENCES epochs (id),
    submission_id TEXT   COLLATE "C" REFERENCES submissions (id),  -- of a grade
    attempt       BIGINT,
    body          TEXT   NOT NULL,                                 -- canonical JSON
    hash          TEXT   COLLATE "C" NOT NULL,
    signature     TEXT   NOT NULL,
    public_key    TEXT   COLLATE "C" NOT NULL
);

-- Written by `/readyz` to see whether writing works.
CREATE TABLE readiness (
    one           BIGINT NOT NULL PRIMARY KEY CHECK (one = 1),
    written_at_ms BIGINT NOT NULL
) WITH (fillfactor = 10);
INSERT INTO readiness (one, written_at_ms) VALUES (1, 0);

-- Tasks that one node does for all, such as settling epochs: who does them, and until when.
CREATE TABLE leases (
    name           TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    holder         TEXT   NOT NULL,
    lease_until_ms BIGINT NOT NULL
) WITH (fillfactor = 10);

-- Facts that all nodes agree on, such as the public key that verifies receipts.
CREATE TABLE agreed (
    name  TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    value TEXT NOT NULL
);

CREATE FUNCTION refuse_change() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'rows of % are permanent', TG_TABLE_NAME;
END $$;
CREATE TRIGGER board_actions_stay BEFORE UPDATE OR DELETE ON board_actions
    FOR EACH ROW EXECUTE FUNCTION refuse_change();
CREATE TRIGGER receipts_stay BEFORE UPDATE OR DELETE ON receipts
    FOR EACH ROW EXECUTE FUNCTION refuse_change();

-- The report that holds for each submission: the latest.
CREATE VIEW latest_reports AS
SELECT r.*
FROM reports r
WHERE r.attempt = (SELECT MAX(l.attempt) FROM reports l WHERE l.submission_id = r.submission_id);

-- Submissions that anybody may see. Answers to hidden instances are none.
CREATE VIEW public_submissions AS
SELECT s.*
FROM submissions s
WHERE s.instance_id IS NULL;
