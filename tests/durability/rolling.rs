//! Upgrades of nodes one after another: former versions go on while a newer one has brought the database up to date.

use std::collections::{BTreeMap, BTreeSet};

use crate::support::cluster::Cluster;

/// Rules on tables of former versions that later migrations add, of which none forbids what former versions write.
const HARMLESS: [&str; 1] = [
    // The list of actions became longer.
    "CHECK ((action = ANY (ARRAY['hide'::text, 'restore'::text, 'regrade'::text, 'withdraw'::text, 'reveal'::text])))",
];

/// Columns of a database: table and column, with type, and whether a statement that does not name it may insert a row.
async fn columns(pool: &sqlx::PgPool) -> BTreeMap<(String, String), (String, bool)> {
    let rows: Vec<(String, String, String, bool)> = sqlx::query_as(
        "SELECT table_name::text, column_name::text, data_type::text, is_nullable = 'YES' OR column_default IS NOT NULL
         FROM information_schema.columns WHERE table_schema = 'public'",
    )
    .fetch_all(pool)
    .await
    .unwrap();
    rows.into_iter().map(|(table, column, kind, is_optional)| ((table, column), (kind, is_optional))).collect()
}

/// Rules that rows must follow: table, columns, and definition of constraints and unique indexes.
async fn rules(pool: &sqlx::PgPool) -> BTreeSet<(String, Vec<String>, String)> {
    let rows: Vec<(String, Vec<String>, String)> = sqlx::query_as(
        "SELECT t.relname::text, ARRAY(SELECT attname::text FROM pg_attribute a WHERE a.attrelid = t.oid AND a.attnum = ANY (c.conkey)),
                pg_get_constraintdef(c.oid)
         FROM pg_constraint c JOIN pg_class t ON t.oid = c.conrelid WHERE t.relnamespace = 'public'::regnamespace
         UNION
         SELECT t.relname::text, ARRAY(SELECT attname::text FROM pg_attribute a WHERE a.attrelid = t.oid AND a.attnum = ANY (i.indkey)),
                pg_get_indexdef(i.indexrelid)
         FROM pg_index i JOIN pg_class t ON t.oid = i.indrelid WHERE i.indisunique AND t.relnamespace = 'public'::regnamespace",
    )
    .fetch_all(pool)
    .await
    .unwrap();
    rows.into_iter().collect()
}

fn files_in(folder: &str) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(crate::support::repository(folder)).unwrap();
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "sql"));
    files
}

/// Nodes are replaced one after another, so the statements of every former version must work on the schema that a later
/// one made: migrations only add, what they add needs no value, and no new rule forbids what was written before.
#[tokio::test]
async fn former_nodes_go_on_while_later_ones_start() {
    let cluster = Cluster::shared();
    let files = files_in("migrations/postgres");
    cluster.create("growing");
    let pool = one_connection(&cluster.url("growing")).await;
    let mut before = BTreeMap::new();
    let mut rules_before = BTreeSet::new();
    for file in &files {
        let text = std::fs::read_to_string(file).unwrap();
        sqlx::raw_sql(sqlx::AssertSqlSafe(text)).execute(&pool).await.unwrap();
        let after = columns(&pool).await;
        for (column, (kind, _)) in &before {
            assert_eq!(
                after.get(column).map(|(kind, _)| kind),
                Some(kind),
                "{column:?} is gone after {}",
                file.display()
            );
        }
        let has_table = |table: &str| before.keys().any(|(known, _)| known == table);
        for ((table, column), (_, is_optional)) in &after {
            let is_new = !before.contains_key(&(table.clone(), column.clone()));
            assert!(
                !is_new || *is_optional || !has_table(table),
                "{table}.{column} of {} needs a value",
                file.display()
            );
        }
        let known: BTreeSet<(String, String)> = before.keys().cloned().collect();
        before = after;
        let now = rules(&pool).await;
        // What is said of new columns alone holds for their defaults, which former versions leave.
        let is_old = |table: &String, column: &String| known.contains(&(table.clone(), column.clone()));
        let new: Vec<_> = now
            .difference(&rules_before)
            .filter(|(table, columns, _)| columns.iter().any(|column| is_old(table, column)))
            .collect();
        assert!(
            new.iter().all(|(_, _, rule)| HARMLESS.contains(&rule.as_str())),
            "{} adds rules to tables that former nodes write to: {new:#?}",
            file.display()
        );
        rules_before = now;
    }
    // What former versions send, as the server received it.
    let recorded = files_in("tests/fixtures/statements");
    assert!(!recorded.is_empty());
    for file in recorded {
        for statement in std::fs::read_to_string(&file).unwrap().lines() {
            let prepared = sqlx::raw_sql(sqlx::AssertSqlSafe(format!("PREPARE former AS {statement}"))).execute(&pool);
            match prepared.await {
                Ok(_) => {}
                // Only the value that is bound tells the type of a parameter. The server says so when it has found no other
                // fault.
                Err(error) if error.to_string().contains("could not determine data type of parameter") => continue,
                Err(error) => panic!("{}: {error}: {statement}", file.display()),
            }
            sqlx::raw_sql("DEALLOCATE former").execute(&pool).await.unwrap();
        }
    }
    // A statement of the first version, which knows nothing of profiles.
    for statement in [
        "INSERT INTO tasks (hash, id, family, body) VALUES ('h', 'f/i', 'f', '{}')",
        "INSERT INTO suites (id, name, version, task_count, content_hash, created_at_ms) VALUES ('s@1', 's', 1, 0, '', 0)",
        "INSERT INTO submissions (id, run_id, suite_id, task_hash, task_number, log_hash, log, log_bytes, turns, events, state,
                                  created_at_ms, owner, replays)
         VALUES ('1', NULL, 's@1', 'h', 1, 'l', '', 0, 1, 0, 'queued', 0, NULL, NULL)",
    ] {
        sqlx::query(statement).execute(&pool).await.unwrap();
    }
    let profile: String = sqlx::query_scalar("SELECT profile FROM public_submissions").fetch_one(&pool).await.unwrap();
    assert_eq!(profile, "published");
}

/// Prepared statements belong to a connection.
async fn one_connection(url: &str) -> sqlx::PgPool {
    sqlx::postgres::PgPoolOptions::new().max_connections(1).connect(url).await.unwrap()
}
