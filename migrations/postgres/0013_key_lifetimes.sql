-- Time for which a key was made, in milliseconds; 0 if it does not expire. The end of a key that is replaced comes sooner, and its
-- replacement lives as long as it was meant to. Unknown for keys that a former version makes while nodes are replaced.
ALTER TABLE keys ADD COLUMN lifetime_ms BIGINT;
UPDATE keys SET lifetime_ms = COALESCE(expires_at_ms - created_at_ms, 0);
