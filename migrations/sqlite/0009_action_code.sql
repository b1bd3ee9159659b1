-- What the action code of a submission's turns did beside its events, as JSON: errors, calls that recorded nothing. Null where
-- the submission brought events.
ALTER TABLE submissions ADD COLUMN replays TEXT;
