//! Looks through the books of a database that no service uses: nothing lost, nothing twice, nothing stuck, quota exact.

use std::path::Path;

use plumbline::store::db::{Pool, query_scalar};

use super::database::pool;

/// Rows that must not be: what is wrong, and a query that finds it.
const WRONG: [(&str, &str); 10] = [
    ("jobs left", "SELECT submission_id FROM jobs"),
    ("submissions that have not ended", "SELECT id FROM submissions WHERE ended_at_ms IS NULL"),
    (
        "graded submissions without one report, or others with any",
        // A regrade that was applied adds reports.
        "SELECT id FROM submissions s
            WHERE (SELECT COUNT(*) FROM reports r WHERE r.submission_id = s.id) NOT BETWEEN
                CASE WHEN s.state = 'graded' THEN 1 ELSE 0 END AND CASE WHEN s.state = 'graded' THEN
                    1 + (SELECT COUNT(*) FROM regrades g WHERE g.state = 'applied' AND g.suite_id = s.suite_id) ELSE 0 END",
    ),
    (
        "runs whose counters are not what their submissions say",
        "SELECT id FROM runs r WHERE pending <> 0
            OR graded <> (SELECT COUNT(*) FROM submissions s WHERE s.run_id = r.id AND s.state = 'graded')
            OR grader_errors <> (SELECT COUNT(*) FROM submissions s
                                 WHERE s.run_id = r.id AND s.state = 'grader_error' AND s.superseded = FALSE)",
    ),
    (
        "submissions of an owner that were not reserved once",
        // The ledger has no index by submission: count its entries once, not for each. An answer to a hidden instance that
        // is given again, because its grading failed, passes on what was reserved for it.
        "SELECT s.id FROM submissions s
            LEFT JOIN (SELECT submission_id, COUNT(*) AS times FROM quota_entries WHERE kind = 'reserve' GROUP BY submission_id) q
                ON q.submission_id = s.id
            WHERE s.owner IS NOT NULL AND COALESCE(q.times, 0)
                <> CASE WHEN s.superseded AND s.instance_id IS NOT NULL THEN 0 ELSE 1 END",
    ),
    (
        "graded submissions that were not charged once, or others that were charged",
        "SELECT s.id FROM submissions s
            LEFT JOIN (SELECT submission_id, COUNT(*) AS times FROM quota_entries WHERE kind = 'charge' GROUP BY submission_id) q
                ON q.submission_id = s.id
            WHERE s.owner IS NOT NULL AND COALESCE(q.times, 0) <> CASE WHEN s.state = 'graded' THEN 1 ELSE 0 END",
    ),
    (
        "ungraded submissions that were not refunded once, or graded ones that were refunded",
        "SELECT s.id FROM submissions s
            LEFT JOIN (SELECT submission_id, COUNT(*) AS times FROM quota_entries WHERE kind = 'refund' GROUP BY submission_id) q
                ON q.submission_id = s.id
            WHERE s.owner IS NOT NULL AND COALESCE(q.times, 0)
                <> CASE WHEN s.state = 'graded' OR (s.superseded AND s.instance_id IS NOT NULL) THEN 0 ELSE 1 END",
    ),
    (
        "owners whose sums are not those of their ledger",
        "SELECT owner FROM quotas o WHERE reserved <> 0 OR charged <>
            (SELECT COUNT(*) FROM quota_entries q WHERE q.owner = o.owner AND kind = 'charge')",
    ),
    (
        "submissions whose end was not told once, or answers to hidden instances whose end was",
        "SELECT s.id FROM submissions s
            LEFT JOIN (SELECT submission_id, COUNT(*) AS told FROM events GROUP BY submission_id) e ON e.submission_id = s.id
            WHERE COALESCE(e.told, 0) <> CASE WHEN s.instance_id IS NULL THEN 1 ELSE 0 END",
    ),
    (
        "runs whose end was not told once, or told before it came",
        "SELECT r.id FROM runs r
            LEFT JOIN (SELECT run_id, COUNT(*) AS told FROM events WHERE submission_id IS NULL GROUP BY run_id) e ON e.run_id = r.id
            WHERE COALESCE(e.told, 0) <> CASE WHEN r.state = 'finished' OR r.deleted_at_ms IS NOT NULL THEN 1 ELSE 0 END",
    ),
];

/// Looks through the books, and that every submission that was acknowledged is in them.
pub async fn audit(database: &Path, acknowledged: &[String], when: &str) {
    audit_books(&pool(database).await, acknowledged, when).await;
}

/// The same, through a pool, which is closed afterwards.
pub async fn audit_books(pool: &Pool, acknowledged: &[String], when: &str) {
    for (what, text) in WRONG {
        let found: Vec<String> = query_scalar(text).fetch_all(pool).await.unwrap();
        assert!(found.is_empty(), "{when}: {what}: {found:?}");
    }
    for id in acknowledged {
        let found: Option<String> =
            query_scalar("SELECT state FROM submissions WHERE id = $1").bind(id).fetch_optional(pool).await.unwrap();
        assert!(found.is_some(), "{when}: the acknowledged submission {id} is lost");
    }
    if matches!(pool, Pool::Sqlite { .. }) {
        let whole: String = query_scalar("PRAGMA integrity_check").fetch_one(pool).await.unwrap();
        assert_eq!(whole, "ok", "{when}");
    }
    pool.close().await;
}
