-- The latest cosignature of each witness of the log, with the checkpoint that it cosigned.
CREATE TABLE cosignatures (
    witness    TEXT NOT NULL PRIMARY KEY,   -- its key: name, identifier and key
    size       INTEGER NOT NULL,                   -- entries of the log
    checkpoint TEXT NOT NULL,                   -- the note as the log signed it
    line       TEXT NOT NULL,                   -- the cosignature
    at_s       INTEGER NOT NULL                    -- time of the cosignature, seconds since 1970
) STRICT;
