-- What many queries need of reports and submissions stands in one place each.

-- The report that holds for each submission: the latest. Grading again adds a report beside the old ones.
CREATE VIEW latest_reports AS
SELECT r.*
FROM reports r
WHERE r.attempt = (SELECT MAX(l.attempt) FROM reports l WHERE l.submission_id = r.submission_id);

-- Submissions that anybody may see. Answers to hidden instances are none: `instances` alone speaks of them.
CREATE VIEW public_submissions AS
SELECT s.*
FROM submissions s
WHERE s.instance_id IS NULL;
