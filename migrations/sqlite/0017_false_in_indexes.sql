-- Statements that serve both databases say `superseded = FALSE`. SQLite uses a partial index only for the same words.
DROP INDEX submissions_one_per_task;
CREATE UNIQUE INDEX submissions_one_per_task ON submissions (run_id, task_number)
    WHERE run_id IS NOT NULL AND superseded = FALSE;
DROP INDEX submissions_one_per_instance;
CREATE UNIQUE INDEX submissions_one_per_instance ON submissions (instance_id)
    WHERE instance_id IS NOT NULL AND superseded = FALSE;
