-- Tasks of a run that its owner leaves out on purpose: they count as failed, and as covered.
CREATE TABLE skipped_tasks (
    run_id      TEXT    NOT NULL REFERENCES runs (id),
    task_number INTEGER NOT NULL,
    PRIMARY KEY (run_id, task_number)
) STRICT;

-- When its owner deleted a run that was still open. It takes no more submissions, never finishes, and is on no list; what was
-- graded of it stays, as its receipts do.
ALTER TABLE runs ADD COLUMN deleted_at_ms INTEGER;
CREATE INDEX runs_by_owner ON runs (owner, created_at_ms);
CREATE INDEX runs_by_age ON runs (created_at_ms);

-- What an owner had used before the first grant, which begins to count then.
ALTER TABLE quotas ADD COLUMN used_before INTEGER NOT NULL DEFAULT 0;
