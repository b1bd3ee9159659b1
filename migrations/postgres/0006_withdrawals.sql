-- Owners withdraw finished runs, and may keep a run anonymous until a date that is public from its beginning.
ALTER TABLE board_actions DROP CONSTRAINT board_actions_action_check;
ALTER TABLE board_actions ADD CONSTRAINT board_actions_action_check
    CHECK (action IN ('hide', 'restore', 'regrade', 'withdraw', 'reveal'));

CREATE TABLE embargoes (
    run_id       TEXT   COLLATE "C" NOT NULL PRIMARY KEY REFERENCES runs (id),
    alias        TEXT   COLLATE "C" NOT NULL,          -- the run has this name for its agent until the embargo is lifted
    agent        TEXT   COLLATE "C" NOT NULL,
    metadata     TEXT   NOT NULL,                      -- JSON; the run has {} until the embargo is lifted
    until_ms     BIGINT NOT NULL,
    lifted_at_ms BIGINT
);
CREATE INDEX embargoes_due ON embargoes (until_ms) WHERE lifted_at_ms IS NULL;
