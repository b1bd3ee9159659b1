-- API keys. Of a key only the hash of its secret is kept; it is shown once, when it is made.
CREATE TABLE keys (
    id              TEXT    NOT NULL PRIMARY KEY,        -- the public part of the key
    owner           TEXT    NOT NULL,                    -- who uses it; runs and submissions belong to owners
    secret_hash     TEXT    NOT NULL,                    -- SHA-256 of the secret part, in hex
    scopes          TEXT    NOT NULL,                    -- submit,grade,read,admin: those it has, by commas
    created_at_ms   INTEGER NOT NULL,
    expires_at_ms   INTEGER,
    revoked_at_ms   INTEGER,
    last_used_at_ms INTEGER                              -- to the minute
) STRICT;
CREATE INDEX keys_by_owner ON keys (owner);

-- Who began a run or posted a submission; null where the service was open to everybody.
ALTER TABLE runs ADD COLUMN owner TEXT;
ALTER TABLE submissions ADD COLUMN owner TEXT;

-- The queue takes turns between owners: a job's turn is one more than the last of its owner's, but never before that of the
-- job that is next. So one owner's thousand jobs do not delay another's one.
ALTER TABLE jobs ADD COLUMN turn INTEGER NOT NULL DEFAULT 0;
DROP INDEX jobs_by_age;
CREATE INDEX jobs_by_turn ON jobs (turn, queued_at_ms, submission_id);
