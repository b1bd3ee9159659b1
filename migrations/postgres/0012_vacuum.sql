-- Tables whose rows change or go again and again leave room in their pages, and are vacuumed before a fifth of them is dead.
ALTER TABLE episodes SET (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.02, autovacuum_vacuum_threshold = 500);
ALTER TABLE deliveries SET (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.02, autovacuum_vacuum_threshold = 500);
ALTER TABLE idempotency SET (autovacuum_vacuum_scale_factor = 0.05, autovacuum_vacuum_threshold = 1000);
ALTER TABLE pending_receipts SET (autovacuum_vacuum_scale_factor = 0, autovacuum_vacuum_threshold = 500);
ALTER TABLE instances SET (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.05);
ALTER TABLE entries SET (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.05);
