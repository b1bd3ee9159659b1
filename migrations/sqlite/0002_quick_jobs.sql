-- Jobs that take next to no time: few events, no stress simulation. A worker takes several of them at once, and records
-- them in one transaction; a long job is always taken alone, so nothing waits behind it.
ALTER TABLE jobs ADD COLUMN quick INTEGER NOT NULL DEFAULT 0;
