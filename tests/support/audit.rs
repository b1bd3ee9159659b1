//! Looks through the books of a database that no service uses: nothing lost, nothing twice, nothing stuck, quota exact.

use std::path::Path;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, SqliteConnection};

/// Rows that must not be: what is wrong, and a query that finds it.
const WRONG: [(&str, &str); 10] = [
    ("jobs left", "SELECT submission_id FROM jobs"),
    ("submissions that have not ended", "SELECT id FROM submissions WHERE ended_at_ms IS NULL"),
    (
        "graded submissions without one report, or others with any",
        "SELECT id FROM submissions s
         WHERE (SELECT COUNT(*) FROM reports r WHERE r.submission_id = s.id) <> (s.state = 'graded')",
    ),
    (
        "runs whose counters are not what their submissions say",
        "SELECT id FROM runs r WHERE pending <> 0
            OR graded <> (SELECT COUNT(*) FROM submissions s WHERE s.run_id = r.id AND s.state = 'graded')
            OR grader_errors <> (SELECT COUNT(*) FROM submissions s
                                 WHERE s.run_id = r.id AND s.state = 'grader_error' AND s.superseded = 0)",
    ),
    (
        "submissions of an owner that were not reserved once",
        "SELECT id FROM submissions s WHERE owner IS NOT NULL AND 1 <>
            (SELECT COUNT(*) FROM quota_entries q WHERE q.submission_id = s.id AND kind = 'reserve')",
    ),
    (
        "graded submissions that were not charged once, and nothing else",
        "SELECT id FROM submissions s WHERE owner IS NOT NULL AND state = 'graded' AND 'charge' IS NOT
            (SELECT group_concat(kind) FROM quota_entries q WHERE q.submission_id = s.id AND kind <> 'reserve')",
    ),
    (
        "other submissions that were not refunded once, and nothing else",
        "SELECT id FROM submissions s WHERE owner IS NOT NULL AND state <> 'graded' AND 'refund' IS NOT
            (SELECT group_concat(kind) FROM quota_entries q WHERE q.submission_id = s.id AND kind <> 'reserve')",
    ),
    (
        "owners whose sums are not those of their ledger",
        "SELECT owner FROM quotas o WHERE reserved <> 0 OR charged <>
            (SELECT COUNT(*) FROM quota_entries q WHERE q.owner = o.owner AND kind = 'charge')",
    ),
    (
        "submissions whose end was not told once",
        "SELECT id FROM submissions s WHERE 1 <> (SELECT COUNT(*) FROM events e WHERE e.submission_id = s.id)",
    ),
    (
        "runs whose end was not told once, or told before it came",
        "SELECT id FROM runs r WHERE (state = 'finished') <>
            (SELECT COUNT(*) FROM events e WHERE e.run_id = r.id AND e.submission_id IS NULL)",
    ),
];

/// A connection to the file.
pub async fn open(database: &Path) -> SqliteConnection {
    SqliteConnectOptions::new().filename(database).connect().await.unwrap()
}

/// Looks through the books, and that every submission that was acknowledged is in them.
pub async fn audit(database: &Path, acknowledged: &[String], when: &str) {
    let mut connection = open(database).await;
    for (what, query) in WRONG {
        let found: Vec<String> = sqlx::query_scalar(query).fetch_all(&mut connection).await.unwrap();
        assert!(found.is_empty(), "{when}: {what}: {found:?}");
    }
    for id in acknowledged {
        let found: Option<String> = sqlx::query_scalar("SELECT state FROM submissions WHERE id = $1")
            .bind(id)
            .fetch_optional(&mut connection)
            .await
            .unwrap();
        assert!(found.is_some(), "{when}: the acknowledged submission {id} is lost");
    }
    let whole: String = sqlx::query_scalar("PRAGMA integrity_check").fetch_one(&mut connection).await.unwrap();
    assert_eq!(whole, "ok", "{when}");
}
