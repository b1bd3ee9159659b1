-- Webhooks: addresses to which the events of an owner are posted, and what is to be posted.
CREATE TABLE webhooks (
    id                  TEXT    NOT NULL PRIMARY KEY,
    owner               TEXT    NOT NULL,
    url                 TEXT    NOT NULL,
    events              TEXT    NOT NULL,                -- names by commas; empty: all
    secret              TEXT    NOT NULL,                -- whsec_…; signing needs it, so it is no hash
    old_secret          TEXT,                            -- also signs until old_secret_until_ms
    old_secret_until_ms INTEGER,
    disabled_reason     TEXT,                            -- null: enabled
    seen_event          INTEGER NOT NULL,                -- the last event whose deliveries are stored
    created_at_ms       INTEGER NOT NULL
) STRICT;
CREATE INDEX webhooks_by_owner ON webhooks (owner, id);

CREATE TABLE deliveries (
    id            TEXT    NOT NULL PRIMARY KEY,          -- the same in every attempt
    webhook_id    TEXT    NOT NULL REFERENCES webhooks (id),
    event_id      INTEGER,                               -- null: a test
    event         TEXT    NOT NULL,                      -- name of the event
    body          TEXT    NOT NULL,                      -- JSON; the same in every attempt
    state         TEXT    NOT NULL CHECK (state IN ('pending', 'delivered', 'dead')),
    attempts      INTEGER NOT NULL DEFAULT 0,
    next_at_ms    INTEGER NOT NULL,                      -- of the next attempt, while pending
    last_status   INTEGER,                               -- HTTP status of the last answer
    last_error    TEXT,
    created_at_ms INTEGER NOT NULL,
    ended_at_ms   INTEGER,
    CHECK ((state = 'pending') = (ended_at_ms IS NULL))
) STRICT;
CREATE UNIQUE INDEX deliveries_of_event ON deliveries (webhook_id, event_id) WHERE event_id IS NOT NULL;
CREATE INDEX deliveries_of_webhook ON deliveries (webhook_id, id);
CREATE INDEX deliveries_due ON deliveries (webhook_id, next_at_ms, id) WHERE state = 'pending';
CREATE INDEX deliveries_ended ON deliveries (state, ended_at_ms) WHERE ended_at_ms IS NOT NULL;
