-- Teams: an owner may have members with roles, to whom keys belong.
CREATE TABLE members (
    owner         TEXT   COLLATE "C" NOT NULL,
    name          TEXT   COLLATE "C" NOT NULL,
    role          TEXT   NOT NULL CHECK (role IN ('reader', 'submitter', 'manager')),
    created_at_ms BIGINT NOT NULL,
    PRIMARY KEY (owner, name)
);

ALTER TABLE keys ADD COLUMN member TEXT COLLATE "C";   -- null: of the owner itself
