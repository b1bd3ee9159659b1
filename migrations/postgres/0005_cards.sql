-- Cards: what a run or an entry was, as its owner declares it. An edit adds a version; none is ever changed.
CREATE TABLE cards (
    id TEXT COLLATE "C" PRIMARY KEY,
    run_id TEXT COLLATE "C" REFERENCES runs (id),      -- one of run and entry
    entry_id TEXT COLLATE "C" REFERENCES entries (id),
    version BIGINT NOT NULL,                           -- from 1
    card TEXT NOT NULL,                                -- JSON, without the text of the system prompt
    system_prompt TEXT,                                -- null: only its hash was given, or nothing
    actor TEXT COLLATE "C",                            -- owner of the key; null: the service was open to everyone
    created_at_ms BIGINT NOT NULL,
    CHECK ((run_id IS NULL) <> (entry_id IS NULL))
);
CREATE UNIQUE INDEX cards_of_run ON cards (run_id, version) WHERE run_id IS NOT NULL;
CREATE UNIQUE INDEX cards_of_entry ON cards (entry_id, version) WHERE entry_id IS NOT NULL;
