-- Time for which a key was made, in milliseconds; none for keys that do not expire, and for older ones. The end of a key that is
-- replaced comes sooner, and its replacement lives as long as it was meant to.
ALTER TABLE keys ADD COLUMN lifetime_ms INTEGER;
