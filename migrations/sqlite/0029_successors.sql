-- Submission that took the place of this one. NULL where none did, where its run skips the task, and where a version before this
-- one stored the successor.
ALTER TABLE submissions ADD COLUMN superseded_by TEXT;
