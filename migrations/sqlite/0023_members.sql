-- Teams: an owner may have members with roles, to whom keys belong.
CREATE TABLE members (
    owner         TEXT    NOT NULL,
    name          TEXT    NOT NULL,
    role          TEXT    NOT NULL CHECK (role IN ('reader', 'submitter', 'manager')),
    created_at_ms INTEGER NOT NULL,
    PRIMARY KEY (owner, name)
) STRICT;

ALTER TABLE keys ADD COLUMN member TEXT;               -- null: of the owner itself
