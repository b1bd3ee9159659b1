-- Sketches of what was built and in which order, of a submission and of a finished run: near-identical runs of different owners
-- show by them.
ALTER TABLE reports ADD COLUMN fingerprint BLOB;
ALTER TABLE results ADD COLUMN fingerprint BLOB;
