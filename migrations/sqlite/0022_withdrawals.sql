-- Owners withdraw finished runs, and may keep a run anonymous until a date that is public from its beginning.
CREATE TABLE board_actions_with_owners (
    id      INTEGER NOT NULL PRIMARY KEY,
    run_id  TEXT    NOT NULL REFERENCES runs (id),
    action  TEXT    NOT NULL CHECK (action IN ('hide', 'restore', 'regrade', 'withdraw', 'reveal')),
    actor   TEXT    NOT NULL,
    reason  TEXT    NOT NULL,
    at_ms   INTEGER NOT NULL
) STRICT;
INSERT INTO board_actions_with_owners SELECT id, run_id, action, actor, reason, at_ms FROM board_actions;
DROP TRIGGER board_actions_stay;
DROP TRIGGER board_actions_stand;
DROP TABLE board_actions;
ALTER TABLE board_actions_with_owners RENAME TO board_actions;
CREATE INDEX board_actions_of_run ON board_actions (run_id, id);
CREATE TRIGGER board_actions_stay BEFORE DELETE ON board_actions
    BEGIN SELECT RAISE(ABORT, 'entries about boards are permanent'); END;
CREATE TRIGGER board_actions_stand BEFORE UPDATE ON board_actions
    BEGIN SELECT RAISE(ABORT, 'entries about boards are permanent'); END;

CREATE TABLE embargoes (
    run_id       TEXT    NOT NULL PRIMARY KEY REFERENCES runs (id),
    alias        TEXT    NOT NULL,                     -- the run has this name for its agent until the embargo is lifted
    agent        TEXT    NOT NULL,
    metadata     TEXT    NOT NULL,                     -- JSON; the run has {} until the embargo is lifted
    until_ms     INTEGER NOT NULL,
    lifted_at_ms INTEGER
) STRICT;
CREATE INDEX embargoes_due ON embargoes (until_ms) WHERE lifted_at_ms IS NULL;
