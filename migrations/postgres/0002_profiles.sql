-- Rules under which the actions of a submission become a build. NULL, as in rows of older exports, means published.
ALTER TABLE submissions ADD COLUMN profile TEXT COLLATE "C" DEFAULT 'published' CHECK (profile IN ('published', 'mindcraft'));

-- Those of all submissions of a run; NULL before the first.
ALTER TABLE runs ADD COLUMN profile TEXT COLLATE "C" CHECK (profile IN ('published', 'mindcraft', 'mixed'));
UPDATE runs SET profile = 'published';

-- A view keeps the columns that its table had when it was made.
CREATE OR REPLACE VIEW public_submissions AS
SELECT s.*
FROM submissions s
WHERE s.instance_id IS NULL;
