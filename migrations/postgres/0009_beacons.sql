-- The pool of an epoch that is bound to a beacon, as JSON: round, signature, root and time. Null until the round came, and for
-- epochs without a beacon, whose root is in their commitment.
ALTER TABLE epochs ADD COLUMN pool TEXT;
