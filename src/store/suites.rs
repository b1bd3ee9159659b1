//! Suites and their tasks. A stored suite never changes; a change needs a new version.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::db::{Tx, query, query_as, query_scalar};
use super::locks::Lock;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::tasks::catalogue::Catalogue;
use plumbline_engine::tasks::{Suite, Task, content_hash_of};

/// Outcome of storing a suite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SuiteStored {
    /// The suite is new.
    Added,
    /// The suite existed already, with the same content.
    Unchanged,
    /// This name and version exist with different content; nothing was stored.
    Conflict,
}

impl Store {
    /// Returns whether the database has each of these suites, given by identifier and content hash.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn has_suites(&self, wanted: &[(&str, &str)]) -> StoreResult<bool> {
        let stored: Vec<(String, String)> =
            query_as("SELECT id, content_hash FROM suites").fetch_all(&self.readers).await?;
        let stored: BTreeMap<String, String> = stored.into_iter().collect();
        Ok(wanted.iter().all(|(id, hash)| stored.get(*id).is_some_and(|own| own == hash)))
    }

    /// Stores a suite with its tasks.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn put_suite(&self, suite: &Suite, now_ms: i64) -> StoreResult<SuiteStored> {
        const STORED: &str = "SELECT content_hash FROM suites WHERE id = $1";
        let hashes: Vec<String> = suite.tasks.iter().map(Task::content_hash).collect();
        let content_hash = content_hash_of(&hashes, suite.preamble.as_deref());
        let outcome = |stored: String| {
            if stored == content_hash { SuiteStored::Unchanged } else { SuiteStored::Conflict }
        };
        // A suite never changes: if it exists, there is nothing to write, and no need to wait for the write lock.
        let stored: Option<String> = query_scalar(STORED).bind(suite.id()).fetch_optional(&self.readers).await?;
        if let Some(stored) = stored {
            return Ok(outcome(stored));
        }
        let mut tx = self.begin().await?;
        tx.lock([Lock::Suites]).await?;
        let stored: Option<String> = query_scalar(STORED).bind(suite.id()).fetch_optional(&mut tx).await?;
        if let Some(stored) = stored {
            return Ok(outcome(stored));
        }
        query(
            "INSERT INTO suites (id, name, version, task_count, content_hash, created_at_ms, preamble)
             VALUES ($1, $2, $3, $4, $5, $6, $7)",
        )
        .bind(suite.id())
        .bind(&suite.name)
        .bind(i64::from(suite.version))
        .bind(suite.tasks.len() as i64)
        .bind(&content_hash)
        .bind(now_ms)
        .bind(suite.preamble.as_deref())
        .execute(&mut tx)
        .await?;
        for (task, hash) in suite.tasks.iter().zip(&hashes) {
            let body = serde_json::to_string(task).map_err(|error| StoreError::corrupt("tasks", error))?;
            query("INSERT INTO tasks (hash, id, family, body) VALUES ($1, $2, $3, $4) ON CONFLICT (hash) DO NOTHING")
                .bind(hash)
                .bind(&task.id)
                .bind(task.family())
                .bind(body)
                .execute(&mut tx)
                .await?;
            query("INSERT INTO suite_tasks (suite_id, number, task_hash) VALUES ($1, $2, $3)")
                .bind(suite.id())
                .bind(i64::from(task.number))
                .bind(hash)
                .execute(&mut tx)
                .await?;
        }
        commit(tx, "put_suite").await?;
        Ok(SuiteStored::Added)
    }

    /// Returns the stored suites as last read.
    #[must_use]
    pub fn catalogue(&self) -> Arc<Catalogue> {
        let held = self.catalogue.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        Arc::clone(&held)
    }

    /// Returns the stored suites as they are now; reads them again only if another process has added some.
    ///
    /// # Errors
    /// Returns an error if the database fails or a task cannot be read.
    pub async fn current_catalogue(&self) -> StoreResult<Arc<Catalogue>> {
        let held = self.catalogue();
        // Suites are never changed or deleted, so comparing their number is enough.
        let stored: i64 =
            query_scalar("SELECT COUNT(*) FROM suites WHERE task_count > 0").fetch_one(&self.readers).await?;
        if held.suites().len() as i64 == stored { Ok(held) } else { self.refresh_catalogue().await }
    }

    /// Reads the suites again.
    ///
    /// # Errors
    /// Returns an error if the database fails or a task cannot be read.
    pub async fn refresh_catalogue(&self) -> StoreResult<Arc<Catalogue>> {
        let catalogue = Arc::new(Catalogue::new(self.suites().await?));
        let mut held = self.catalogue.write().unwrap_or_else(std::sync::PoisonError::into_inner);
        *held = Arc::clone(&catalogue);
        Ok(catalogue)
    }

    /// Returns all suites with their tasks, by name and version.
    ///
    /// # Errors
    /// Returns an error if the database fails or a task cannot be read.
    pub async fn suites(&self) -> StoreResult<Vec<Suite>> {
        // In the order of the index: sorting would write the bodies of all tasks to a temporary file.
        let rows = query(
            "SELECT s.name, s.version, s.preamble, t.body
             FROM suite_tasks st CROSS JOIN suites s CROSS JOIN tasks t
             WHERE s.id = st.suite_id AND t.hash = st.task_hash
             ORDER BY st.suite_id, st.number",
        )
        .fetch_all(&self.readers)
        .await?;
        let mut suites: Vec<Suite> = Vec::new();
        for row in rows {
            let name: String = row.get("name")?;
            let version = u32::try_from(row.get::<i64>("version")?).map_err(|e| StoreError::corrupt("suites", e))?;
            let body: &str = row.get("body")?;
            let task: Task = serde_json::from_str(body).map_err(|error| StoreError::corrupt("tasks", error))?;
            match suites.last_mut() {
                Some(suite) if suite.name == name && suite.version == version => suite.tasks.push(task),
                _ => suites.push(Suite { name, version, preamble: row.get("preamble")?, tasks: vec![task] }),
            }
        }
        suites.sort_by(|a, b| (&a.name, a.version).cmp(&(&b.name, b.version)));
        Ok(suites)
    }
}

/// Reads the tasks of a suite within the transaction.
pub(super) async fn tasks_of(tx: &mut Tx, suite_id: &str) -> StoreResult<Vec<Task>> {
    let bodies: Vec<String> = query_scalar(
        "SELECT t.body FROM suite_tasks st JOIN tasks t ON t.hash = st.task_hash WHERE st.suite_id = $1
         ORDER BY st.number",
    )
    .bind(suite_id)
    .fetch_all(&mut *tx)
    .await?;
    bodies.iter().map(|body| serde_json::from_str(body).map_err(|error| StoreError::corrupt("tasks", error))).collect()
}
