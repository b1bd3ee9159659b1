-- Readers lock the view first, and then its table: in another order, both would wait for each other.
LOCK TABLE public_submissions IN ACCESS EXCLUSIVE MODE;

-- Submission that took the place of this one. NULL where none did, where its run skips the task, and where a version before this
-- one stored the successor.
ALTER TABLE submissions ADD COLUMN superseded_by TEXT COLLATE "C";

-- A view keeps the columns that its table had when it was made.
CREATE OR REPLACE VIEW public_submissions AS
SELECT s.*
FROM submissions s
WHERE s.instance_id IS NULL;
