-- How long a lease was given for. One that began after now is of a clock that was set back since, and counts as run out.
ALTER TABLE jobs ADD COLUMN lease_ms INTEGER NOT NULL DEFAULT 0;
