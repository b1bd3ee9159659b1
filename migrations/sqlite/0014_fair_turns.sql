-- Jobs wait in three lanes: quick ones, others, and answers to hidden instances, whose pace others shall not see. Within a lane each
-- owner's jobs have turns one after another, none before the greatest turn of which a job was taken; that one never falls.
ALTER TABLE jobs ADD COLUMN lane TEXT NOT NULL DEFAULT 'long' CHECK (lane IN ('quick', 'long', 'hidden'));
ALTER TABLE jobs ADD COLUMN owner TEXT NOT NULL DEFAULT '';  -- '' where the service was open to everybody
UPDATE jobs SET
    owner = COALESCE((SELECT s.owner FROM submissions s WHERE s.id = jobs.submission_id), ''),
    lane = CASE
        WHEN EXISTS (SELECT 1 FROM submissions s WHERE s.id = jobs.submission_id AND s.instance_id IS NOT NULL) THEN 'hidden'
        WHEN quick = 1 THEN 'quick'
        ELSE 'long'
    END;
DROP INDEX jobs_by_turn;
ALTER TABLE jobs DROP COLUMN quick;
CREATE INDEX jobs_by_turn ON jobs (lane, turn, queued_at_ms, submission_id);
CREATE INDEX jobs_of_owner ON jobs (lane, owner, turn);

CREATE TABLE lanes (
    name TEXT    NOT NULL PRIMARY KEY,
    turn INTEGER NOT NULL             -- the greatest of which a job was taken
) STRICT;
INSERT INTO lanes (name, turn)
    SELECT l.name, COALESCE((SELECT MIN(j.turn) FROM jobs j WHERE j.lane = l.name), 0)
    FROM (SELECT 'quick' AS name UNION ALL SELECT 'long' UNION ALL SELECT 'hidden') l;

-- Written by `/readyz` to see whether writing works.
CREATE TABLE readiness (
    one           INTEGER NOT NULL PRIMARY KEY CHECK (one = 1),
    written_at_ms INTEGER NOT NULL
) STRICT;
INSERT INTO readiness (one, written_at_ms) VALUES (1, 0);
