-- Rules under which the actions of a submission become a build. NULL, as in rows of older exports, means published.
ALTER TABLE submissions ADD COLUMN profile TEXT DEFAULT 'published' CHECK (profile IN ('published', 'mindcraft'));

-- Those of all submissions of a run; NULL before the first.
ALTER TABLE runs ADD COLUMN profile TEXT CHECK (profile IN ('published', 'mindcraft', 'mixed'));
UPDATE runs SET profile = 'published';
