-- Facts that all processes agree on, such as where large logs and reports are.
CREATE TABLE agreed (
    name  TEXT NOT NULL PRIMARY KEY,
    value TEXT NOT NULL
) STRICT;

-- Large logs and reports may be objects outside the database. The column then holds a reference of 82 bytes:
-- `object:2026-11-24/` and the SHA-256 of the packed bytes in hex. Other rows of that length are few.
CREATE INDEX submissions_as_objects ON submissions (log) WHERE length(log) = 82;
CREATE INDEX reports_as_objects ON reports (body) WHERE length(body) = 82;
CREATE INDEX regraded_as_objects ON regraded (body) WHERE length(body) = 82;
