-- What requests with an Idempotency-Key came to, written in the transaction of their effect: the same request again gets
-- the same answer and has no effect. Kept for 24 hours.
CREATE TABLE idempotency (
    owner         TEXT    NOT NULL,                      -- '' where the service was open to everybody
    key           TEXT    NOT NULL,
    body_hash     TEXT    NOT NULL,                      -- SHA-256 over operation and body, in hex
    result        TEXT    NOT NULL,                      -- what the answer is made from, as JSON
    created_at_ms INTEGER NOT NULL,
    PRIMARY KEY (owner, key)
) STRICT;
CREATE INDEX idempotency_by_age ON idempotency (created_at_ms);
