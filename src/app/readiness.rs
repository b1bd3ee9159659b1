//! Readiness: whether the database can be written and read.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;
use crate::clock::now_ms;
use crate::clock::steady::is_doubted;
use crate::store::location::Location;
use crate::store::opened_file::OpenedFile;
use crate::store::schema;
use crate::store::{StoreError, StoreResult};

/// How long a result holds; more frequent probes cost nothing.
const HOLDS_FOR: Duration = Duration::from_secs(1);
/// Time that the database may take.
const PATIENCE: Duration = Duration::from_secs(4);

/// What the last look came to: what the node lacks, or why it is not ready.
type Found = Result<Vec<String>, &'static str>;

/// Recent result of writing to and reading from the database. One task looks; others wait for its result.
#[derive(Debug, Default)]
pub struct Readiness {
    looking: tokio::sync::Mutex<()>,
    last: Mutex<Option<(Instant, Found)>>,
}

/// Checks that the database can be written and read, at most a second ago. Returns what the node lacks although it is
/// ready, for people to read.
///
/// # Errors
/// Returns an error that says why it is not ready.
pub async fn check(app: &Arc<App>) -> AppResult<Vec<String>> {
    // A prober that gives up sooner must not take the result from the others.
    let looking = Arc::clone(app);
    let found = tokio::spawn(async move { looking.readiness.look(&looking).await });
    let found = found.await.map_err(|error| AppError::internal(&error))?;
    found.map_err(|detail| AppError::new(Kind::NotReady, detail).retry_after(1))
}

/// Checks the same for at most `patience`, and after that returns what the last look came to: what the node lacks, if it
/// was ready. None if it was not, or if nobody has looked yet.
pub async fn check_within(app: &Arc<App>, patience: Duration) -> Option<Vec<String>> {
    match tokio::time::timeout(patience, check(app)).await {
        Ok(found) => found.ok(),
        Err(_late) => app.readiness.last().and_then(|(_, found)| found.ok()),
    }
}

/// Returns what the node lacks: its secrets, keys of epochs, the folder of large logs, a clock that can be believed, or a
/// whole log of receipts.
async fn lacking(app: &App) -> StoreResult<Vec<String>> {
    let mut lacking = Vec::new();
    // A node signs with the key that it read, but does not start again without its file. One without a database has none.
    let keeps_keys = !matches!(app.store.location(), Location::Memory);
    if app.signer.is_none() || (keeps_keys && !app.store.secrets().has_signer().unwrap_or(false)) {
        lacking.push("secrets".to_owned());
    }
    if app.signer.is_some() {
        // What an epoch that is over kept secret is revealed with its key.
        for epoch in app.store.epochs().await? {
            if !app.store.secrets().has_epoch(epoch.id()) {
                lacking.push(format!("key of epoch {}", epoch.id()));
            }
        }
    }
    if app.store.missing_folder().await.is_some() {
        lacking.push("folder of large logs and reports".to_owned());
    }
    if is_doubted() {
        lacking.push("clock that does not jump".to_owned());
    }
    if app.log.is_damaged() {
        lacking.push("intact log of receipts".to_owned());
    }
    Ok(lacking)
}

impl Readiness {
    fn last(&self) -> Option<(Instant, Found)> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    async fn look(&self, app: &App) -> Found {
        let store = &app.store;
        let _looking = self.looking.lock().await;
        if let Some((_, found)) = self.last().filter(|(at, _)| at.elapsed() < HOLDS_FOR) {
            return found;
        }
        let probe = async {
            // The file comes first: without it, reading says no more than that it cannot be opened.
            store.file().map_or(Ok(()), OpenedFile::must_be_in_place)?;
            store.probe(now_ms()).await?;
            StoreResult::Ok((store.free_bytes().await, lacking(app).await?))
        };
        let new = match tokio::time::timeout(PATIENCE, probe).await {
            // A small write may still fit where a submission does not.
            Ok(Ok((Some(free), _))) if free < LIMITS.disk_room_bytes => {
                tracing::error!(
                    free,
                    needed = LIMITS.disk_room_bytes,
                    "not ready: the disk of the database has too little room"
                );
                Err("The disk of the database has less than 2 MiB of room.")
            }
            Ok(Err(error @ StoreError::LostFile(_))) => {
                tracing::error!(%error, "not ready");
                Err("The database file was deleted, moved or replaced; the service's log says what to do.")
            }
            Ok(Ok((_, lacking))) => Ok(lacking),
            Ok(Err(error)) => {
                tracing::error!(%error, "not ready");
                Err("The database cannot be written or read; the service's log says why.")
            }
            Err(_late) if matches!(store.location(), Location::Server(_)) => {
                // Whoever waits for a connection of the pool does not learn why there is none.
                let why = match tokio::time::timeout(PATIENCE, schema::state(store.location())).await {
                    Ok(Ok(_)) => "it answers a new connection".to_owned(),
                    Ok(Err(error)) => error.to_string(),
                    Err(_late) => "a new connection gets no answer either".to_owned(),
                };
                tracing::error!(%why, "not ready: the database server did not answer in time");
                Err(
                    "The database server did not answer in time: it may be down, or out of reach; the service's log says why.",
                )
            }
            Err(_late) => {
                tracing::error!(seconds = PATIENCE.as_secs(), "not ready: the database could not be written in time");
                Err("The database could not be written in time: another process may hold its lock.")
            }
        };
        let before = self.last.lock().unwrap_or_else(PoisonError::into_inner).replace((Instant::now(), new.clone()));
        if new.is_ok() && before.is_some_and(|(_, found)| found.is_err()) {
            tracing::info!("ready again");
        }
        new
    }
}
