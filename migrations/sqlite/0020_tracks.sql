-- Two tracks of prompts: a run is prompted by one of them, and the suite has the conventions that the short one takes for
-- granted.
ALTER TABLE suites ADD COLUMN preamble TEXT;               -- null: the suite has no track `brief`
ALTER TABLE runs ADD COLUMN track TEXT                     -- null: specified, as all runs were before
    CHECK (track IN ('specified', 'brief'));
